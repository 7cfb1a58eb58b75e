"""
The files that tell of a survey's buildings, written side by side in one pass over the buildings.

Of more buildings than one file should hold there is a folder per block, and an index of the blocks. Blocks
are the squares of a quadtree. The index is a GeoJSON like a collection of items of STAC (stacspec.org),
without dates, so that equal surveys give equal bytes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from importlib import import_module
from itertools import chain, product
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.files.atomic_files import Waiting, atomic_folder, writing
from lidar_buildings.io.files.reference_systems import is_same_unit, model_frame, reprojected, unit_name
from lidar_buildings.io.models.other_names import OTHER_NAMES
from lidar_buildings.io.models.survey_building import (
    BUILDING_FIELDS,
    Add,
    ModelHeading,
    SurveyBuilding,
    TerrainMesh,
)
from lidar_buildings.io.models.tiles3d import EarthFrame, NoPlaceError
from lidar_buildings.io.results.output_config import (
    FORMAT_FILES,
    OUTPUT_FORMATS,
    STREET_LAYERS,
    TILES,
    OutputConfig,
)
from lidar_buildings.io.results.run_folder import BLOCKS, output_names
from lidar_buildings.io.results.run_summary import BuildingCounts
from lidar_buildings.io.results.survey_buildings import SurveyBuildings

_NO_GEOID = (
    "3D Tiles are off by the height of the geoid, tens of metres in most places: no grid turns the inputs' "
    "elevations into heights above the ellipsoid: give --geoid FILE or METRES, or fetch a grid (`projsync`)"
)


def model_heading(
    inputs: Sequence[InputFile], frame: MapFrame, crs: str, files: OutputConfig
) -> tuple[ModelHeading, list[Remark]]:
    """Return what a survey's city model says of itself, and why a format cannot be made that is wanted."""
    names = output_names(inputs)
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    title = f"Buildings of {names[0]}{more}" if names else ""
    models = model_frame(frame)
    if not is_same_unit(models.vertical_unit, frame.vertical_unit):
        title, heights = f"{title}; x, y and z in {unit_name(models.vertical_unit)}", models.crs
    else:
        heights = crs
    fields = BUILDING_FIELDS | OTHER_NAMES[files.attributes]
    heading = ModelHeading(title, heights, frame=models, fields=fields)
    if TILES not in files.formats:
        return heading, []
    try:
        earth = EarthFrame(frame, crs, files.geoid_height, files.geoid_grid)
    except NoPlaceError as error:
        why = f"no 3D Tiles were made: {error}: give one (--crs), or remove {TILES} from model_writer.formats"
        return heading, [Remark("no_tiles3d", why)]
    return heading._replace(earth=earth), [Remark("no_geoid", _NO_GEOID)] if earth.lacks_geoid else []


def write_buildings(
    folder: Path,
    buildings: SurveyBuildings,
    formats: Collection[str],
    heading: ModelHeading,
    terrain: Iterable[TerrainMesh] = (),
    facades: Sequence[Facade] = (),
) -> tuple[list[str], BuildingCounts]:
    """
    Write buildings in some of `OUTPUT_FORMATS`; a file appears, complete, when its last building is written.

    `terrain` stands behind the buildings in every format of models, `facades` in layers. Returned are the
    names of the files, and counts of the buildings; of those with an outline, where there are any outlines.
    OutputError if a file cannot be written.
    """
    # 3D Tiles stand on the earth, or nowhere
    chosen = [name for name in FORMAT_FILES if name in formats and (heading.earth or name != TILES)]
    heading = heading._replace(frame=buildings.frame, extent=buildings.extent)
    outlined, traced = BuildingCounts(), BuildingCounts()
    with ExitStack() as stack:
        # what is opened last ends first: layers are written at their end, where a disk may be found full
        paths = {name: folder / FORMAT_FILES[name][0] for name in reversed(chosen)}
        opened = {path: stack.enter_context(writer_of(name)(path, heading)) for name, path in paths.items()}

        def add_to_all(one: SurveyBuilding | TerrainMesh) -> None:
            for path in reversed(opened):
                with writing(path):  # else the file opened last would be named
                    opened[path](one)

        for building in buildings:
            add_to_all(building)
            if building.outline is not None:
                outlined.count(building.attributes)
            if building.traced is not None:
                traced.count(building.attributes)
        for facade, name in product(facades, chosen):
            if OUTPUT_FORMATS[name].of_outlines:
                with writing(paths[name]):
                    opened[paths[name]](facade)
        if not all(OUTPUT_FORMATS[name].of_outlines for name in chosen):
            for mesh in terrain:
                add_to_all(mesh)
    files = [file for name in chosen for file in FORMAT_FILES[name] if (folder / file).exists()]
    if facades and _INSTEAD["gpkg"] in chosen:
        files += [f"{layer}.fgb" for layer in STREET_LAYERS]
    return files, outlined if outlined.total else traced


def writer_of(name: str) -> Callable[[Path, ModelHeading], AbstractContextManager[Add]]:
    """Import the writer of a format."""
    module, _, function = OUTPUT_FORMATS[name].writer.partition(":")
    writer: Callable[[Path, ModelHeading], AbstractContextManager[Add]]
    writer = getattr(import_module(f"lidar_buildings.io.{module}"), function)
    return writer


INDEX = "index.json"
#: What a block has instead of a GeoPackage: one layer a file, which readers over a network can read in parts.
_INSTEAD = {"gpkg": "flatgeobuf"}
_DEGREES = "EPSG:4326"
_DECIMALS = 7
#: Squares are not divided further below this side, that of a square of the terrain in models [m].
_SMALLEST = 256.0


def write_in_blocks(
    folder: Path,
    buildings: SurveyBuildings,
    formats: Collection[str],
    heading: ModelHeading,
    terrain: Iterable[TerrainMesh] = (),
    facades: Sequence[Facade] = (),
    *,
    largest: int,
) -> tuple[list[str], BuildingCounts]:
    """
    Write buildings as `write_buildings` does, the files of each block into a folder of its own.

    FlatGeobuf stands for GeoPackage there. 3D Tiles are divided by themselves, and not again. A block has at
    most the `largest` number of buildings.
    """
    in_blocks = {_INSTEAD.get(name, name) for name in formats if name != TILES}
    squares = squares_of(buildings.places(), largest)
    fronts: list[list[Facade]] = [[] for _ in squares]
    for facade in facades:
        fronts[_nearest(squares, facade.foot.mean(axis=0))].append(facade)
    tiles: list[str] = []
    total = BuildingCounts()
    items = []
    with atomic_folder(folder / BLOCKS) as blocks, TemporaryFile(dir=blocks) as file:
        #: pieces of terrain by the number of the square around each, or nearest to it
        meshes: Waiting[int, TerrainMesh] = Waiting(file)
        for mesh in terrain:
            middle = (mesh.vertices[:, :2].min(axis=0) + mesh.vertices[:, :2].max(axis=0)) / 2.0
            meshes.add(_nearest(squares, middle), mesh)
        parts = buildings.parts(rows for _, rows in squares)
        for number, ((square, rows), part) in enumerate(zip(squares, parts, strict=True)):
            x, y, _ = buildings.frame.to_source(np.array([[square.west, square.south, 0.0]]))[0]
            block = blocks / f"block-{x:.0f}-{y:.0f}"
            block.mkdir()
            files, counts = write_buildings(
                block, part, in_blocks, heading, meshes.of(number), fronts[number]
            )
            total.add(counts)
            items.append(
                _item(
                    block,
                    files,
                    {"buildings": len(rows), "statuses": dict(sorted(counts.statuses.items()))},
                    part,
                )
            )
        lines = ",\n".join(json.dumps(item, ensure_ascii=False) for item in items)
        index = f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'
        (blocks / INDEX).write_text(index, encoding="utf-8")
        if TILES in formats:
            all_meshes = chain.from_iterable(map(meshes.of, range(len(squares))))
            tiles, _ = write_buildings(folder, buildings, [TILES], heading, all_meshes)
    return [BLOCKS, *tiles], total


def _nearest(squares: Sequence[tuple[Square, NDArray[np.intp]]], place: NDArray[np.float64]) -> int:
    away = [square.distance(place) for square, _ in squares]
    return away.index(min(away))


def _item(block: Path, files: list[str], facts: dict[str, Any], part: SurveyBuildings) -> dict[str, Any]:
    """Return what the index says of a block: where it lies, on the earth too, counts, and files."""
    item: dict[str, Any] = {"type": "Feature", "stac_version": "1.0.0", "id": block.name, "geometry": None}
    properties: dict[str, Any] = {"datetime": None, **facts}
    if part.bounds is not None:
        box = shapely.box(*part.frame.to_source(np.insert(part.bounds, 2, 0.0, axis=1))[:, :2].ravel())
        properties["proj:bbox"] = np.round(box.bounds, 3).tolist()
        if crs := part.frame.crs:
            properties["proj:code" if crs.startswith("EPSG:") else "proj:wkt2"] = crs
            (around,) = reprojected(np.array([box]), crs, _DEGREES, str(block))
            if np.isfinite(around.bounds).all():
                item["geometry"] = json.loads(
                    shapely.to_geojson(shapely.set_precision(around, 10.0**-_DECIMALS))
                )
                item["bbox"] = np.round(around.bounds, _DECIMALS).tolist()
    assets = {
        file: {"href": f"{block.name}/{file}", "file:size": (block / file).stat().st_size} for file in files
    }
    return item | {"properties": properties, "assets": assets, "links": []}


class Square(NamedTuple):
    """A square of the map: its south-western corner and its side [m]."""

    west: float
    south: float
    side: float

    def distance(self, place: NDArray[np.float64]) -> float:
        """Return how far a place is outside [m]."""
        away = np.abs(place - [self.west, self.south] - self.side / 2.0) - self.side / 2.0
        return float(np.hypot(*np.maximum(away, 0.0)))


def squares_of(places: NDArray[np.float64], largest: int) -> list[tuple[Square, NDArray[np.intp]]]:
    """
    Divide places, shape (n, 2), one at least, into squares of at most so many, or of the smallest side.

    By a quadtree on multiples of 256 m. Returned are the squares that hold places, and the rows of these;
    from west to east, then from south to north.
    """
    cells = np.floor(places / _SMALLEST)
    west, south = (cells.min(axis=0) * _SMALLEST).tolist()
    n_cells = int((cells.max(axis=0) - cells.min(axis=0)).max()) + 1
    waiting = [(Square(west, south, _SMALLEST * 2 ** (n_cells - 1).bit_length()), np.arange(len(places)))]
    found = []
    while waiting:
        square, rows = waiting.pop()
        if len(rows) <= largest or square.side <= _SMALLEST:
            found.append((square, rows))
            continue
        half = square.side / 2.0
        beyond = places[rows] >= [square.west + half, square.south + half]
        for east, north in product((False, True), repeat=2):
            own = rows[(beyond == [east, north]).all(axis=1)]
            if len(own):
                waiting.append((Square(square.west + east * half, square.south + north * half, half), own))
    return sorted(found, key=lambda one: one[0])
