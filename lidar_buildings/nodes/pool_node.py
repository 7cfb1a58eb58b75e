"""What the nodes that let processes work do alike."""

from __future__ import annotations

from typing import Any

from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.ros.stage_node import StageNode


class PoolNode(StageNode):
    """Base of nodes that wait for no interpreter's lock: a pool's processes work, or they do without."""

    def __init__(self, name: str, pool: BuildingPool | None = None, **kwargs: Any) -> None:
        super().__init__(name, NODE_CONFIGS[name], **kwargs)
        self._pool = pool or BuildingPool(0)
