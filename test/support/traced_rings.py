"""What every traced outline has to be."""

import numpy as np
import shapely

from lidar_buildings.core.model.outline import signed_area


def polygon(outline):
    return shapely.Polygon(outline.exterior, outline.holes)


def overlap(one, other):
    return one.intersection(other).area / one.union(other).area


def assert_sound(traced, points, tolerance=1e-5):
    """A ring always exists, is simple and turned the right way, and has every point inside or on it."""
    shape = polygon(traced.outline)
    assert shape.is_valid
    assert shape.area > 0
    assert signed_area(traced.outline.exterior) > 0
    assert all(signed_area(hole) < 0 for hole in traced.outline.holes)
    near = tolerance * traced.point_spacing + 1e-9 * np.abs(points).max()
    shapely.prepare(shape)
    assert shapely.dwithin(shape, shapely.points(points[:, :2]), near).all()
