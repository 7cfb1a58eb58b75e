"""Node `edge_labeller`."""

from __future__ import annotations

from typing import Any

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.nodes.pool_node import PoolNode
from lidar_buildings.pipeline.tile_stages import label_roof_edges


class EdgeLabeller(PoolNode):
    """Labels the roof points on edges."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("edge_labeller", **kwargs)
        self._edge_points = self.create_tile_outlet("edge_points")
        self.subscribe_tiles("roof_points", self.on_tile)

    def on_tile(self, tile: PointTile) -> dict[str, int]:
        """Label one tile; report how many of its roofs came to which status."""
        labelled = self._pool.call(label_roof_edges, tile, self.parameters[EdgeLabellingConfig])
        self._edge_points.publish(tile.stamp, labelled.tile)
        return {f"roofs_{status}": number for status, number in labelled.n_roofs.items()}
