"""Roofs to label the edges of."""

import numpy as np
import shapely

from bench.scenes import buildings as scenes


def roof_and_truth(name, **sampling):
    """Return roof points and their distance from the outline, in point spacings."""
    scene = getattr(scenes, name)(**sampling)
    points = scene.points[scene.is_roof]
    outline = shapely.union_all([building.polygon.boundary for building in scene.buildings])
    distance = shapely.distance(outline, shapely.points(points[:, :2]))
    return points, distance * np.sqrt(sampling["density"])


def level_roof(x, y, z=10.0, *, density=8.0, noise=0.02, seed=0):
    """Return the points of a level rectangle, as evenly spread as those of a scan."""
    random, step = np.random.default_rng(seed), 1 / np.sqrt(density)
    lattice = np.meshgrid(np.arange(*x, step), np.arange(*y, step))
    plan = np.column_stack([axis.ravel() for axis in lattice]) + 0.5 * step
    plan += random.uniform(-0.3, 0.3, plan.shape) * step
    return np.column_stack([plan, z + random.normal(0, noise, len(plan))])


def sphere(n=6000):
    """Return evenly spread points of a sphere: a surface that ends nowhere."""
    k = np.arange(n)
    z, angle = 1 - (2 * k + 1) / n, k * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z * z)
    return 20 * np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
