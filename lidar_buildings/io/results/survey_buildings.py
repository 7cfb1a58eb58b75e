"""The buildings of all tiles, each once and in the order of their ids; pieces that another tile has whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.ids import anchor_near, anchor_row, readable_id
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.io.files.atomic_files import Waiting, compact_json, writing
from lidar_buildings.io.models.cityjson import CityFeature, load_feature, parse_feature
from lidar_buildings.io.models.other_names import OWN, other_attributes
from lidar_buildings.io.models.survey_building import SurveyBuilding, in_source_units
from lidar_buildings.io.results.tile_products import Shapes

#: Attribute and column that carries a footprint's name.
_FOOTPRINT_ID = "footprint_id"
#: Ids differ within twice this distance [m].
_NEAR = 16_000.0
#: A building of which this share lies within a larger one of another tile is a piece of that one;
#: wide margin: pieces lie within it entirely, neighbours not at all.
_PIECE_SHARE = 0.5


class _Entry(NamedTuple):
    """What is kept in memory of a building."""

    place: NDArray[np.float64]  #: somewhere on the building, the map's origin where nothing tells [m]
    bounds: NDArray[np.float64] | None  #: of its outline in plan
    extent: NDArray[np.float64] | None  #: of its solids, None if there are none, see `SurveyBuildings`
    lod: str  #: the finest level of detail, empty if there are no solids


class SurveyBuildings:
    """
    Collects buildings tile by tile, but for some; they wait in a file until they are asked for.

    `footprint_id` leads from a building id to what the file of footprints calls it, which becomes one of the
    building's attributes; None where outlines were traced. `names` are those of `OTHER_NAMES` under which
    attributes stand, too. OutputError if the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        frame: MapFrame,
        *,
        without: Collection[int] = (),
        footprint_id: Mapping[int, str] | None = None,
        names: str = OWN,
    ) -> None:
        self.frame = frame
        self._names = names
        self._without = frozenset(without)
        self._footprint_id = footprint_id
        self._entries: dict[tuple[int, str], _Entry] = {}
        self._places: dict[int, list[NDArray[np.float64]]] = {}
        self._path = path
        self.largest = (0, "")  #: points and name of the building with the most
        with writing(self._path):
            self._file = open(path, "w+b")  # noqa: SIM115 (open as long as the object)
        self._waiting: Waiting[tuple[int, str], SurveyBuilding] = Waiting(self._file)

    def __enter__(self) -> SurveyBuildings:
        return self

    def __exit__(self, *_: object) -> None:
        # what could not be written was said when the tile was added, and closing tries to write it again
        with suppress(OSError):
            self._file.close()

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def extent(self) -> NDArray[np.float64] | None:
        """Least and greatest coordinates of all solids, shape (2, 3) [m], None if there are none."""
        return _extent_of([one.extent for one in self._entries.values()])

    @property
    def bounds(self) -> NDArray[np.float64] | None:
        """The same of outlines and solids in plan, shape (2, 2)."""
        extents = [one.extent[:, :2] for one in self._entries.values() if one.extent is not None]
        return _extent_of([*(one.bounds for one in self._entries.values()), *extents])

    @property
    def levels(self) -> Counter[str]:
        """Finest level of detail → number of buildings; those without solids are left out."""
        return Counter(one.lod for one in self._entries.values() if one.lod)

    def places(self) -> NDArray[np.float64]:
        """Return where the buildings are, shape (n, 2), by id and name, map frame [m]."""
        places = [anchor_near(key[0], self._entries[key].place) for key in sorted(self._entries)]
        return np.array(places, dtype=np.float64).reshape(-1, 2)

    def parts(self, rows: Iterable[NDArray[np.intp]]) -> Iterator[SurveyBuildings]:
        """Yield parts of the survey, each of some rows of `places`."""
        keys = sorted(self._entries)
        for own in rows:
            part = copy(self)
            part._entries = {keys[row]: self._entries[keys[row]] for row in own.tolist()}
            yield part

    def add(self, shapes: Shapes) -> None:
        """Add a tile's buildings that did not come before; InputError if a line to be named is no feature."""
        traced = {one.building_id: one.outline for one in shapes.traced}
        outlines = {one.building_id: one.outline for one in shapes.outlines}
        named = [(line, parse_feature(line)) for line in map(self._named, shapes.features)]
        models = {int(feature.attributes["building_id"]): (line, feature) for line, feature in named}
        with writing(self._path):
            for number in sorted((traced.keys() | outlines.keys() | models.keys()) - self._without):
                before, after = traced.get(number), outlines.get(number)
                line, feature = models.get(number) or ("", self._without_model(number, before, after))
                key = number, feature.readable_id
                if key not in self._entries and self._is_new(number, before or after):
                    self._entries[key] = _entry(after or before, feature)
                    name, attributes, _, *model = feature
                    building = SurveyBuilding(number, name, before, after, line, attributes, *model)
                    self._waiting.add(key, building)
                    self.largest = max(self.largest, (attributes.get("n_points") or 0, name))
            self._file.flush()

    def __iter__(self) -> Iterator[SurveyBuilding]:
        """Yield the buildings by id and name, one at a time."""
        for key in sorted(self._entries):
            yield next(self._waiting.of(key))

    def _is_new(self, number: int, outline: Outline | None) -> bool:
        """Whether no building with this id came nearby; its name may differ by what was scanned later."""
        if outline is None or not len(outline.exterior):
            return True
        place, others = outline.exterior[0], self._places.setdefault(number, [])
        if any(np.abs(place - other).max() < _NEAR for other in others):
            return False
        others.append(place)
        return True

    def _named(self, line: str) -> str:
        """Return a feature's line with the footprint's name and other names of attributes, if any."""
        if self._footprint_id is None and self._names == OWN:
            return line
        feature, number = load_feature(line)
        building = feature["CityObjects"][feature["id"]]
        attributes = building["attributes"]
        if self._footprint_id is not None:
            attributes[_FOOTPRINT_ID] = self._footprint_id.get(number, "")
        attributes |= other_attributes(self._names, attributes, feature["id"], parse_feature(line).roof_faces)
        building["attributes"] = dict(sorted(attributes.items()))
        return compact_json(feature)

    def _without_model(self, number: int, before: Outline | None, after: Outline | None) -> CityFeature:
        """Return what the outline alone tells in a run without models."""
        known: dict[str, Any] = {"area": after.area} if after else {}
        if self._footprint_id is not None:
            known[_FOOTPRINT_ID] = self._footprint_id.get(number, "")
        name, outline = "", before or after
        if outline is not None and len(outline.exterior):
            # its westernmost vertex, or the place a footprint's id is of
            vertices = np.column_stack([outline.exterior, np.zeros(len(outline.exterior))])
            if self._footprint_id is not None:
                vertices = np.array([[*anchor_near(number, vertices[0]), 0.0]])
            places = self.frame.to_source(vertices)
            name = readable_id(*places[anchor_row(places)][:2])
        return CityFeature(name, in_source_units(known, self.frame))


def _entry(outline: Outline | None, feature: CityFeature) -> _Entry:
    exterior = np.empty((0, 2)) if outline is None else outline.exterior
    extent = feature.extent
    place = exterior[0] if len(exterior) else np.zeros(2) if extent is None else extent[0, :2]
    return _Entry(place, _extent_of([exterior]), extent, str(feature.attributes.get("lod") or ""))


def _extent_of(places: Sequence[NDArray[np.float64] | None]) -> NDArray[np.float64] | None:
    known = [one for one in places if one is not None and len(one)]
    if not known:
        return None
    all_places = np.concatenate(known)
    return np.stack([all_places.min(axis=0), all_places.max(axis=0)])


def seam_pieces(tiles: Sequence[Sequence[BuildingOutline]]) -> set[int]:
    """
    Return the ids of buildings, of those of each tile, that are pieces of a larger building of another tile.

    Points near the edge of a tile's buffer can be judged otherwise than in the middle of the next tile, and a
    part connected by a few points then seems to be a building of its own. Buildings of one tile never overlap
    by so much and are never taken for pieces of each other; nor is a building a piece of itself, as another
    tile had it before it went over to this one.
    """
    outlines = [one for tile in tiles for one in tile]
    tile_of = np.repeat(np.arange(len(tiles)), [len(tile) for tile in tiles])
    number = np.array([one.building_id for one in outlines], dtype=np.int64)
    polygons = shapely.make_valid(np.array([one.outline.polygon for one in outlines], dtype=object))
    area = shapely.area(polygons)
    first, second = shapely.STRtree(polygons).query(polygons)
    # by falling size; equal ones by id, so that the order of tiles does not matter
    rank = np.lexsort((number, -area)).argsort()
    chosen = (tile_of[first] != tile_of[second]) & (number[first] != number[second])
    chosen &= rank[first] > rank[second]
    smaller, larger = first[chosen], second[chosen]
    shared = shapely.area(shapely.intersection(polygons[smaller], polygons[larger]))
    is_piece = (shared >= _PIECE_SHARE * area[smaller]) & (area[smaller] > 0)
    return {outlines[row].building_id for row in smaller[is_piece]}
