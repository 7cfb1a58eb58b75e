"""Edges of roofs: those of a reference by alpha shapes, and the score of those labelled."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.edge_labelling.rims import on_rims
from lidar_buildings.core.stages.footprints.footprints import last_polygon_around
from lidar_buildings.core.surfaces.surface_patches import connected_parts
from lidar_buildings.evaluation.scores.cells import Confusion, Figures, confusion_of, named

#: Smaller parts of a reference's class are noise, not roofs: as small as a run drops them [m²].
MIN_ROOF_AREA = 6.0
#: What a point of no roof has in place of a number.
NO_ROOF = -1


def fewest_points(spacing: float) -> int:
    """Return how many points of this spacing [m] the smallest roof has."""
    return math.ceil(MIN_ROOF_AREA / spacing**2)


def roofs_of_polygons(points: ArrayLike, polygons: ArrayLike) -> NDArray[np.int64]:
    """Return the first of the polygons, one a roof or block, that each point lies in or on; −1 for none."""
    valid = shapely.make_valid(np.atleast_1d(np.asarray(polygons, dtype=object)))
    # From the last to the first, so that the first one stays.
    found = last_polygon_around(np.asarray(points, dtype=np.float64)[:, :2], valid[::-1])
    return np.where(found >= 0, len(valid) - 1 - found.astype(np.int64), NO_ROOF)


def roofs_of_points(points: ArrayLike, gap: float, *, min_points: int = 1) -> NDArray[np.int64]:
    """Number the parts of a cloud that gaps up to `gap` [m] in plan connect, −1 for too small ones."""
    cloud = checked_points(points)
    part = connected_parts(cloud, gap, in_plan=True)
    is_small = np.bincount(part, minlength=1)[part] < min_points if len(part) else np.zeros(0, dtype=bool)
    return np.where(is_small, NO_ROOF, part)


#: Radius of the disc by which Santos, Galo and others found their reference [m], and the density of their
#: cloud [points/m²]: elsewhere the radius is as many point spacings, 1.342.
PAPER_ALPHA, PAPER_DENSITY = 0.60, 5.0


def alpha_of_spacing(spacing: float) -> float:
    """Return the radius that is to the spacing as 0.60 m is to that of 5 points/m² [m]."""
    return PAPER_ALPHA * math.sqrt(PAPER_DENSITY) * spacing


def reference_edges(points: ArrayLike, roof: ArrayLike, alpha: float) -> NDArray[np.bool_]:
    """
    Return the points that lie on the alpha shape of their roof (Santos, Galo and others, section 2.4).

    Those are the points that an empty disc can touch in plan (Edelsbrunner, Kirkpatrick & Seidel 1983:
    *alpha-extreme*). They write the disc's radius as −1/α, later authors as √α; here alpha is the radius [m].
    A negative number of a roof is none, and its points are no edges.
    """
    cloud = checked_points(points)
    number = checked_column("roof", roof, len(cloud), np.int64)
    # Points of no roof make up a roof of their own, which the others do not see.
    every = np.ones(len(cloud), dtype=np.bool_)
    edge = on_rims(sort_by_cell(cloud, 2.0 * alpha), every, number, radius=alpha, reach=0.0)
    return edge & (number >= 0)


def score_edges(result: ArrayLike, reference: ArrayLike) -> Figures:
    """Compare the labels of the same points, edge or not; ValueError if the lengths differ."""
    edge = confusion_of(result, reference)
    other = Confusion(edge.rejections, edge.misses, edge.false_alarms, edge.hits)
    found: Figures = {
        "n_points": edge.total,
        "n_edges_reference": edge.hits + edge.misses,
        "n_edges_result": edge.hits + edge.false_alarms,
    }
    for name, one in (("edge", edge), ("non_edge", other)):
        shares = {"completeness": one.recall, "correctness": one.precision, "f_score": one.f1}
        found.update(named(name, shares))
    return found
