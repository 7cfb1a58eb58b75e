"""Node `plane_fitter`."""

from __future__ import annotations

from typing import Any

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.nodes.pool_node import PoolNode
from lidar_buildings.pipeline.tile_stages import fit_planes


class PlaneFitter(PoolNode):
    """Finds the planes of each building's roof."""

    has_pool = True

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("plane_fitter", **kwargs)
        self._plane_points = self.create_tile_outlet("plane_points")
        self.subscribe_tiles("building_points", self.on_tile)

    def on_tile(self, tile: PointTile) -> None:
        """Fit the planes of one tile's buildings."""
        planes = fit_planes(tile, self.parameters[PlaneFittingConfig], self._pool)
        self._plane_points.publish(tile.stamp, planes)
