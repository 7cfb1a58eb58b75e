"""
Walls shared by touching buildings: one line for both, no gap between them and no overlap.

`common_lines` lays facing walls on one line, `partition` shares out what then is left between the buildings.
"""

from lidar_buildings.core.stages.regularisation.shared_walls.sharing import SharedWalls, share_walls

__all__ = ["SharedWalls", "share_walls"]
