"""How well a model agrees with its points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.stages.building_model.outline_coverage import outline_coverage
from lidar_buildings.core.stages.building_model.roof_face import RoofFacePatch
from lidar_buildings.core.stages.building_model.surface_distance import distance_to_surface

#: Spots farther than this from any point are without data [spacings].
_EMPTY_DISTANCE = 2.0
#: A point agrees with the model if it is nearer than this [m].
_AGREES = 0.3
#: A point so near to the plane of its face is measured against that only [m].
_NEAR = 0.05


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
    rmse = math.sqrt((misfit * misfit).sum() / len(misfit)) if len(points) else None
    covered, no_data = outline_coverage(
        outline, points[:, :2], misfit <= _AGREES, spacing, _EMPTY_DISTANCE * spacing
    )
    return ModelQuality(rmse, covered, no_data)


def _misfits(faces: list[RoofFacePatch], points: FloatArray) -> FloatArray:
    """Return every point's distance to the plane of the face over or under it [m]."""
    rows, planes = np.concatenate([face.rows for face in faces]), np.array([face.plane for face in faces])
    lengths = np.sqrt(1.0 + planes[:, 0] ** 2 + planes[:, 1] ** 2)
    each = np.column_stack([planes, lengths]).repeat([len(face.rows) for face in faces], axis=0)
    (x, y, z), (a, b, c, length) = points[rows].T, each.T
    # The plane goes on beside the outline, the roof does not.
    distance = np.full(len(points), np.inf)
    distance[rows] = np.abs(z - (a * x + b * y) - c) / length
    return distance
