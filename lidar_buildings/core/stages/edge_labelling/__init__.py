"""Edge labelling: which roof points lie on edges."""

from lidar_buildings.core.stages.edge_labelling.clusters import OK, ONE_CLUSTER, TOO_FEW_POINTS
from lidar_buildings.core.stages.edge_labelling.config import AS_PUBLISHED, EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.labelling import EdgeLabels, label_edges

__all__ = [
    "AS_PUBLISHED",
    "OK",
    "ONE_CLUSTER",
    "TOO_FEW_POINTS",
    "EdgeLabellingConfig",
    "EdgeLabels",
    "label_edges",
]
