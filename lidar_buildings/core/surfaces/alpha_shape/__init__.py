"""The 2D alpha shape of a point set: `shape` is what others call, `mesh` the triangles it is read from."""

from lidar_buildings.core.surfaces.alpha_shape.shape import AlphaShape, alpha_shape

__all__ = ["AlphaShape", "alpha_shape"]
