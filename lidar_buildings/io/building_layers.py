"""
The buildings of all tiles as the layers of ``buildings.gpkg`` and the lines of ``city_model.city.jsonl``.

"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.building_id import anchor_near, anchor_row, readable_id
from lidar_buildings.core.map_frame import MapFrame
from lidar_buildings.core.outline import BuildingOutline
from lidar_buildings.io.building_attributes import BUILDING_FIELDS, in_source_units
from lidar_buildings.io.cityjson import CityFeature, parse_feature
from lidar_buildings.io.footprint_results import FOOTPRINT_ID
from lidar_buildings.io.geopackage import GeoPackageLayer
from lidar_buildings.io.tile_products import RoofFace, Shapes

#: Column with the name that stays the same in every file, made from the anchor's coordinates.
READABLE_ID = "readable_id"
_NO_FEATURE = "unknown"

_Named = TypeVar("_Named", BuildingOutline, RoofFace)


class BuildingLayers:
    """
    Collects buildings tile by tile, in the order of stamps.

    Parameters
    ----------
    frame : MapFrame
        Of the tiles.
    without : collection of int
        Ids of buildings to leave out.
    footprint_id : mapping or None
        Building id → what the file of footprints calls it; None where outlines were traced.

    """

    def __init__(
        self,
        frame: MapFrame,
        *,
        without: Collection[int] = (),
        footprint_id: Mapping[int, str] | None = None,
    ) -> None:
        self._frame = frame
        self._without = frozenset(without)
        self._footprint_id = footprint_id
        self._traced: list[tuple[dict[str, Any], shapely.Polygon]] = []
        self._outlines: list[tuple[dict[str, Any], shapely.Polygon]] = []
        self._faces: list[tuple[dict[str, Any], shapely.Polygon]] = []
        self._lines: dict[str, tuple[int, str]] = {}

    def add(self, shapes: Shapes) -> None:
        """
        Add a tile's buildings.

        """
        features = {}
        for line in shapes.features:
            feature = parse_feature(line)
            if feature.building_id in self._without:
                continue
            features[feature.building_id] = feature
            self._lines.setdefault(feature.readable_id, (feature.building_id, line))
        for one in self._kept(shapes.traced):
            self._traced.append((self._named(one, features), self._polygon(one.outline.rings)))
        for one in self._kept(shapes.outlines):
            known = self._attributes(one, features.get(one.building_id))
            self._outlines.append((known | self._named(one, features), self._polygon(one.outline.rings)))
        for face in self._kept(shapes.roof_faces):
            self._faces.append((self._named(face, features), self._polygon(face.rings)))

    def _kept(self, group: Iterable[_Named]) -> list[_Named]:
        """
        Return those that are not to be left out.

        """
        return [one for one in group if one.building_id not in self._without]

    def layers(self) -> list[GeoPackageLayer]:
        """
        Return the layers, rows by building id.

        """
        names: dict[str, type] = {"building_id": int, READABLE_ID: str}
        return [
            _layer("outlines", self._outlines, BUILDING_FIELDS | {READABLE_ID: str}),
            _layer("traced", self._traced, names),
            _layer("roof_faces", self._faces, names, is_3d=True),
        ]

    def lines(self) -> list[str]:
        """
        Return the CityJSONFeature lines by building id.

        """
        return [line for _, line in sorted(self._lines.values())]

    def statuses(self) -> dict[str, int]:
        """
        Count the buildings by status.

        """
        counted = Counter(row.get("status") or _NO_FEATURE for row, _ in self._outlines or self._traced)
        return dict(sorted(counted.items()))

    def _named(self, one: BuildingOutline | RoofFace, features: dict[int, CityFeature]) -> dict[str, Any]:
        """
        Return the two ids of a building.

        """
        feature = features.get(one.building_id)
        rings = one.outline.rings if isinstance(one, BuildingOutline) else one.rings
        name = feature.readable_id if feature else self._name_of(one.building_id, rings[0])
        return {"building_id": one.building_id, READABLE_ID: name}

    def _name_of(self, number: int, ring: NDArray[np.float64]) -> str:
        """
        Name a building that has no feature by its westernmost vertex, or by the place a footprint's id is of.

        """
        vertices = self._in_source(ring)
        if self._footprint_id is not None and len(ring):
            place = np.array([[*anchor_near(number, ring[0]), 0.0]])
            return readable_id(*self._frame.to_source(place)[0][:2])
        return readable_id(*vertices[anchor_row(vertices)][:2]) if len(vertices) else ""

    def _attributes(self, one: BuildingOutline, feature: CityFeature | None) -> dict[str, Any]:
        """
        Return a building's attributes; what its outline alone tells in a run without models.

        """
        if feature is not None:
            return feature.attributes
        known: dict[str, Any] = {"area": one.outline.area}
        if self._footprint_id is not None:
            known[FOOTPRINT_ID] = self._footprint_id.get(one.building_id, "")
        return in_source_units(known, self._frame)

    def _polygon(self, rings: Iterable[NDArray[np.float64]]) -> shapely.Polygon:
        """
        Return rings as a polygon in source coordinates, empty where a ring is none.

        """
        shell, *holes = [self._in_source(ring) for ring in rings]
        if len(shell) < 3:
            return shapely.Polygon()
        return shapely.Polygon(shell, [hole for hole in holes if len(hole) >= 3])

    def _in_source(self, ring: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return a ring's vertices, of 2 or 3 coordinates, in source coordinates of 3.

        """
        vertices = np.zeros((len(ring), 3))
        vertices[:, : ring.shape[1]] = ring
        return self._frame.to_source(vertices)


def _layer(
    name: str,
    rows: list[tuple[dict[str, Any], shapely.Polygon]],
    fields: dict[str, type],
    *,
    is_3d: bool = False,
) -> GeoPackageLayer:
    """
    Return one layer, its rows by building id; equal ids stay in the order of their tiles.

    """
    ordered = sorted(rows, key=lambda row: row[0]["building_id"])
    return GeoPackageLayer(
        name, [polygon for _, polygon in ordered], fields, [row for row, _ in ordered], is_3d
    )
