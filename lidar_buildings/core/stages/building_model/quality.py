"""How well a model agrees with its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from lidar_buildings.core.model.array_types import BoolArray, FloatArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.stages.building_model.cell_costs import EMPTY_DISTANCE
from lidar_buildings.core.stages.building_model.roof_face import RoofFacePatch
from lidar_buildings.core.stages.building_model.surface_distance import distance_to_surface

#: A point agrees with the model if it is nearer than this [m].
_AGREES = 0.3
#: A point so near to the plane of its face is measured against that only [m].
_NEAR = 0.05
#: Most spots at which an outline is probed.
_MAX_SPOTS = 10_000


@dataclass(frozen=True)
class ModelQuality:
    """
    Agreement of one level of detail with the points.

    Attributes
    ----------
    rmse : float or None
        Root mean square of the points' distances to the surface of the solid, walls included [m].
    coverage : float
        Share of the outline's area with a point near that agrees with the model.
    no_data_share : float
        Share of the outline's area without any point near.
    """

    rmse: float | None
    coverage: float
    no_data_share: float


def measure_model(
    faces: list[RoofFacePatch], solid: Solid, points: FloatArray, outline: Outline, spacing: float
) -> ModelQuality:
    """
    Measure how well roof faces agree with the points.

    Parameters
    ----------
    faces : list of RoofFacePatch
        Of the level of detail; points over none of them are measured against the nearest one.
    solid : Solid
        Of the level of detail.
    points : ndarray of shape (n_points, 3)
        The building's points [m].
    outline : Outline
        The building's [m].
    spacing : float
        Point spacing [m].
    """
    misfit = _misfits(faces, points)
    far = np.flatnonzero(misfit > _NEAR)
    misfit[far] = distance_to_surface(points[far], solid, misfit[far])
    rmse = float(np.sqrt(np.mean(misfit**2))) if len(points) else None
    spots = _spots(outline, spacing)
    if not len(spots) or not len(points):
        return ModelQuality(rmse, 0.0, 1.0)
    reach = EMPTY_DISTANCE * spacing
    agrees = misfit <= _AGREES
    no_data = ~_is_near(spots, points[:, :2], reach)
    covered = ~no_data if agrees.all() else _is_near(spots, points[agrees, :2], reach)
    return ModelQuality(rmse, float(covered.mean()), float(no_data.mean()))


def _is_near(spots: FloatArray, xy: FloatArray, reach: float) -> BoolArray:
    """Whether places have a position within reach."""
    # Any position in the same cell of this size is near; the tree is asked about the other places only.
    size = reach / 1.5
    low = np.minimum(spots.min(axis=0), xy.min(axis=0, initial=np.inf)) // size
    cells, own = ((each // size - low).astype(np.int64) for each in (spots, xy))
    n_rows = max(int(cells[:, 1].max()), int(own[:, 1].max(initial=0))) + 1
    near = np.isin(cells @ [n_rows, 1], own @ [n_rows, 1])
    rest = np.flatnonzero(~near)
    if len(rest) and len(xy):
        near[rest] = np.isfinite(cKDTree(xy).query(spots[rest], distance_upper_bound=reach)[0])
    return np.asarray(near)


def _misfits(faces: list[RoofFacePatch], points: FloatArray) -> FloatArray:
    """Return every point's distance to the plane of the face over or under it [m]."""
    number = np.full(len(points), -1, dtype=np.int64)
    for k, face in enumerate(faces):
        number[face.rows] = k
    beside = np.flatnonzero(number < 0)
    number[beside] = 0
    planes = np.array([face.plane for face in faces])[number]
    above = points[:, 2] - np.einsum("ij,ij->i", planes[:, :2], points[:, :2]) - planes[:, 2]
    distance = np.abs(above) / np.sqrt(1.0 + planes[:, 0] ** 2 + planes[:, 1] ** 2)
    # The plane goes on beside the outline, the roof does not.
    distance[beside] = np.inf
    return np.asarray(distance)


def _spots(outline: Outline, spacing: float) -> FloatArray:
    """Return places inside an outline on a regular grid."""
    if len(outline.exterior) < 3 or outline.area <= 0:
        return np.zeros((0, 2))
    low, high = outline.exterior.min(axis=0), outline.exterior.max(axis=0)
    step = max(spacing, float(np.prod(high - low) / _MAX_SPOTS) ** 0.5)
    x, y = (np.arange(a + 0.5 * min(step, b - a), b, step) for a, b in zip(low, high, strict=True))
    spots = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    polygon = outline.polygon
    shapely.prepare(polygon)
    return spots[shapely.contains_xy(polygon, spots)]
