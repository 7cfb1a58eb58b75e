"""What topics say of a tile, gathered by the writer until it can be put on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters
from lidar_buildings.io.models.cityjson import load_feature
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.nodes.topics import CITY_MODEL, OUTLINES, ROOF_FACES, TRACED_OUTLINES
from lidar_buildings.ros.features import FeaturePool, closed_tile, is_withdrawal
from lidar_buildings.ros.polygons import Rings
from lidar_buildings.ros.ring_collector import outlines_of
from lidar_buildings.ros.tile_join import Parts, TileJoin, agree_on_buildings

Rasterise = Callable[[PointTile], TerrainRasters | None]


@dataclass(frozen=True, eq=False)
class _AllPoints:
    """All points of a tile, and what makes their rasters when first asked for; None where none are wanted."""

    tile: PointTile
    rasters: Callable[[], TerrainRasters | None]


class TileGathering:
    """
    Gathers the parts of tiles; one that is complete is returned by the call that made it so.

    The first topic carries all points; tiles wait until it is known where the map lies.
    """

    def __init__(
        self, topics: Sequence[str], rasterise: Rasterise, knows_frame: Callable[[], bool] = lambda: True
    ) -> None:
        self._topics = topics
        self._rasterise = rasterise
        self._knows_frame = knows_frame
        self._features = FeaturePool()
        self._join = TileJoin((t for t in topics if t != CITY_MODEL.name), agree_on_buildings, self._is_ready)

    def add_points(self, topic: str, tile: PointTile) -> Parts | None:
        """Take points of one tile."""
        if topic != self._topics[0]:
            return self._join.add(tile.stamp, topic, tile)
        return self._join.add(tile.stamp, topic, _AllPoints(tile, cache(partial(self._rasterise, tile))))

    def add_rings(self, topic: str, stamp: int, rings: Rings) -> Parts | None:
        """
        Take outlines or roof faces of one tile.

        Outlines are traced of a tile that is large enough: its rasters are made while its models are built.
        """
        if topic == TRACED_OUTLINES.name and self._knows_frame():
            all_points = self._join.part(stamp, self._topics[0])
            if all_points is not None:
                all_points.rasters()
        # the models have the faces; that they have come is all that is to know
        return self._join.add(stamp, topic, None if topic == ROOF_FACES.name else outlines_of(rings))

    def add_feature(self, line: str) -> Iterable[tuple[int, Parts]]:
        """
        Take a line of a city model; return the tiles that have waited for it.

        InputError if a feature is not one of a building.
        """
        if not line.startswith('{"type":"CityJSONFeature"'):
            return []
        stamp = closed_tile(line)
        if stamp is not None:
            self._features.close(stamp)
            return self.take_ready()
        if not is_withdrawal(line):  # the tile's later revision lacks the building in any case
            self._features.add(load_feature(line)[1], line)
        return []

    def take_ready(self) -> Iterable[tuple[int, Parts]]:
        """Yield the stamps and parts of the tiles that have become complete."""
        return self._join.take_ready()

    def products(self, parts: Parts, *, has_names: bool = True) -> TileProducts:
        """
        Return what is put on disk of a complete tile.

        Where points must have names, which point of which input they are, those that have none are left out:
        points of somebody else, of which there are no files.
        """
        all_points = parts[self._topics[0]]
        roofs = [parts[topic] for topic in self._topics if isinstance(parts.get(topic), PointTile)]
        clouds = [all_points.tile, *roofs]
        if not has_names and any(one.source is None or one.index is None for one in clouds):
            clouds = [one.select(np.zeros(0, dtype=np.intp)) for one in clouds]
        return TileProducts.from_tiles(
            *clouds,
            traced=parts.get(TRACED_OUTLINES.name, ()),
            outlines=parts.get(OUTLINES.name, ()),
            features=self._features.take(sorted(self._buildings_of(parts))),
            rasters=all_points.rasters(),
        )

    def _is_ready(self, stamp: int, parts: Parts) -> bool:
        """Whether it is known where a tile lies, and the models of all its buildings have come."""
        if not self._knows_frame():
            return False
        return CITY_MODEL.name not in self._topics or self._features.has(stamp, self._buildings_of(parts))

    def _buildings_of(self, parts: Parts) -> set[int]:
        """Return the buildings whose models a tile must wait for."""
        if CITY_MODEL.name not in self._topics:
            return set()
        return {one.building_id for one in parts[OUTLINES.name]}
