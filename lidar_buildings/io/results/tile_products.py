"""What a run keeps of one tile, and how it lies on disk until the run ends."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import COLUMNS, PointTile
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters
from lidar_buildings.core.stages.terrain.window import RasterWindow
from lidar_buildings.io.files.atomic_files import atomic_file

_NAME = ("source", "index")
#: numpy parses the arrays' headers with `ast`, which fails now and then in two threads at once
#: (Python 3.11, https://github.com/python/cpython/issues/106905).
_READING = threading.Lock()
#: Names under which a tile's rasters are saved.
_WINDOW, _RASTERS, _VARIANCE = "window", ("dtm", "dsm", "distance"), "dtm_variance"
#: Rows of a tile's core points, of its buildings' points, and of its core roof points.
CORE, ROOFS, EDGES = (
    np.dtype([(name, COLUMNS[name]) for name in (*_NAME, *columns)])
    for columns in (
        ("classification", "height_above_ground", "facade", "view"),
        ("building_id", "plane_id", "edge"),
        ("edge",),
    )
)


@dataclass(frozen=True, eq=False)
class TileProducts:
    """The results of one tile."""

    stamp: int  #: the tile's key, of the revision that they are of [ns]
    #: `source`, `index`, `classification`, `height_above_ground`, `facade`, `view` of every core point,
    #: structured.
    core: NDArray[Any]
    #: `source`, `index`, `building_id`, `plane_id`, `edge` of all points, core and buffer, of the tile's own
    #: buildings, structured.
    roofs: NDArray[Any]
    edges: NDArray[Any]  #: `source`, `index`, `edge` of the core roof points, structured
    #: Before and after regularisation.
    traced: tuple[BuildingOutline, ...] = ()
    outlines: tuple[BuildingOutline, ...] = ()
    features: tuple[str, ...] = ()  #: CityJSONFeature lines
    facades: tuple[Facade, ...] = ()  #: walls seen from the street
    rasters: TerrainRasters | None = None  #: ground and surface cell by cell, None where none are wanted

    @property
    def n_buildings(self) -> int:
        """Number of buildings, as far as the run went."""
        return len(self.outlines or self.traced)

    @classmethod
    def from_tiles(
        cls,
        classified: PointTile,
        planes: PointTile | None = None,
        traced: Iterable[BuildingOutline] = (),
        outlines: Iterable[BuildingOutline] = (),
        features: Iterable[str] = (),
        facades: Iterable[Facade] = (),
        rasters: TerrainRasters | None = None,
    ) -> TileProducts:
        """
        Gather a tile's results.

        `classified` has every point with its final class and height above ground, `planes` the roof points,
        core and buffer, with edge labels, building and plane ids as far as the run went.
        """
        roof_tile = planes if planes is not None else classified.select(np.zeros(0, dtype=np.intp))
        in_building = np.zeros(len(roof_tile), dtype=bool)
        if roof_tile.building_id is not None:
            in_building = roof_tile.building_id > 0
        labelled = roof_tile.is_core if roof_tile.edge is not None else np.zeros(len(roof_tile), dtype=bool)
        return cls(
            classified.stamp,
            _rows(classified, CORE, classified.is_core),
            _rows(roof_tile, ROOFS, in_building),
            _rows(roof_tile, EDGES, labelled),
            tuple(traced),
            tuple(outlines),
            tuple(features),
            tuple(one for one in facades if one.is_core),
            rasters,
        )

    def save(self, path: Path) -> None:
        """Write one file, which appears when it is complete; OutputError if it cannot be written."""
        polygons = {"traced": self.traced, "outlines": self.outlines}
        shapes = {
            name: [[one.building_id, [ring.tolist() for ring in one.outline.rings]] for one in group]
            for name, group in polygons.items()
        }
        tables = {"core": self.core, "roofs": self.roofs, "edges": self.edges}
        sources = np.unique(np.concatenate([rows["source"] for rows in tables.values()]))
        by_source = {
            _table_name(name, source): rows.compress(rows["source"] == source)
            for name, rows in tables.items()
            for source in sources.tolist()
        }
        rasters: dict[str, NDArray[Any]] = {}
        if self.rasters is not None:
            window = self.rasters.window
            place = (window.resolution, window.column, window.row, window.width, window.height)
            rasters = {name: getattr(self.rasters, name) for name in _RASTERS}
            if self.rasters.dtm_variance is not None:
                rasters[_VARIANCE] = self.rasters.dtm_variance
            rasters[_WINDOW] = np.array(place, dtype=np.float64)  # whole numbers up to 2^53 fit
        with atomic_file(path, has_rivals=True) as temporary, open(temporary, "wb") as file:
            np.savez(
                file,
                stamp=np.int64(self.stamp),
                sources=sources,
                shapes=_as_bytes(shapes),
                features=_as_bytes(list(self.features)),
                facades=_as_bytes([one.record for one in self.facades]),
                **by_source,
                **rasters,
            )


class Shapes(NamedTuple):
    """What a tile knows of its buildings beside their points."""

    traced: tuple[BuildingOutline, ...]
    outlines: tuple[BuildingOutline, ...]
    features: tuple[str, ...]


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    with _READING, np.load(path) as held:
        yield held


def load_shapes(path: Path) -> Shapes:
    """Read the buildings of a saved tile."""
    with _opened(path) as held:
        shapes, features = (json.loads(held[name].tobytes()) for name in ("shapes", "features"))
    return Shapes(
        _outlines_from_lists(shapes["traced"]), _outlines_from_lists(shapes["outlines"]), tuple(features)
    )


def load_outlines(path: Path) -> tuple[BuildingOutline, ...]:
    """Read the outlines of a saved tile, the traced ones of a run that ended before they were regularised."""
    with _opened(path) as held:
        shapes = json.loads(held["shapes"].tobytes())
    return _outlines_from_lists(shapes["outlines"] or shapes["traced"])


def load_facades(path: Path) -> tuple[Facade, ...]:
    """Read the façades of a saved tile."""
    with _opened(path) as held:
        return tuple(Facade.of_record(one) for one in json.loads(held["facades"].tobytes()))


def load_raster_window(path: Path) -> RasterWindow | None:
    """Read which cells the rasters of a saved tile have, None if it has none."""
    with _opened(path) as held:
        return _window_of(held) if _WINDOW in held else None


def load_rasters(path: Path) -> TerrainRasters:
    """Read the rasters of a saved tile that has some."""
    with _opened(path) as held:
        names = (*_RASTERS, _VARIANCE) if _VARIANCE in held else _RASTERS
        return TerrainRasters(_window_of(held), *(held[name] for name in names))


def has_variance(path: Path) -> bool:
    """Tell whether a saved tile has the variance of its terrain."""
    with _opened(path) as held:
        return _VARIANCE in held


def _window_of(held: Any) -> RasterWindow:
    resolution, *place = held[_WINDOW].tolist()
    return RasterWindow(resolution, *map(int, place))


def load_stamp(path: Path) -> int:
    """Read the key of a saved tile, of the revision that it holds [ns]."""
    with _opened(path) as held:
        return int(held["stamp"])


def load_sources(path: Path) -> list[int]:
    """Read from which inputs a saved tile has points."""
    with _opened(path) as held:
        sources: list[int] = held["sources"].tolist()
    return sources


def load_rows(path: Path, name: str, source: int) -> NDArray[Any]:
    """Read what one table of a saved tile, ``core``, ``roofs`` or ``edges``, says of an input's points."""
    with _opened(path) as held:
        table: NDArray[Any] = held[_table_name(name, source)]
        return table


def _table_name(name: str, source: int) -> str:
    return f"{name}_{source}"


def _as_bytes(content: Any) -> NDArray[np.uint8]:
    return np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)


def _rows(tile: PointTile, dtype: np.dtype[Any], chosen: NDArray[np.bool_]) -> NDArray[Any]:
    """Copy chosen rows of a tile's columns into a table, zeros where the tile lacks the column."""
    table = np.zeros(int(np.count_nonzero(chosen)), dtype)
    for name in dtype.names or ():
        column = getattr(tile, name)
        if column is not None:
            table[name] = column[chosen]
        elif name in _NAME and len(table):
            raise ValueError(f"{name} is missing: must name every point of the tile")
    return table


def _outlines_from_lists(lists: list[Any]) -> tuple[BuildingOutline, ...]:
    rings = ([np.array(ring, dtype=np.float64).reshape(-1, 2) for ring in own] for _, own in lists)
    outlines = (Outline(exterior, tuple(holes)) for exterior, *holes in rings)
    return tuple(BuildingOutline(one[0], outline) for one, outline in zip(lists, outlines, strict=True))
