"""What the nodes that let processes work do alike."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any, ClassVar

from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stage_node import StageNode


class PoolNode(StageNode):
    """Base of nodes that wait for no interpreter's lock: a pool's processes work, or they do without."""

    #: Whether it has a pool where it is a process of its own.
    has_pool: ClassVar[bool] = False

    def __init__(self, name: str, pool: BuildingPool | None = None, **kwargs: Any) -> None:
        super().__init__(name, NODE_CONFIGS[name], **kwargs)
        self._pool = pool or BuildingPool(0)

    @classmethod
    def main(cls) -> int:
        """Run the node as a process of its own."""
        with BuildingPool() if cls.has_pool else nullcontext() as pool:
            return run_node(lambda: cls(pool=pool))
