"""
Heights of roof faces that the points bear out, and the parts of a roof that share one height.

"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.building_model.partition import RoofFacePatch
from lidar_buildings.core.linked_sets import sets_of_pairs

#: A face whose points lie farther off in the middle than this gets a plane of its own [m].
_MAX_MEDIAN_MISFIT = 0.25
#: A face of its own may slope if it has so many points, and rises by no more than this [m/m].
_MIN_POINTS, _MAX_RISE = 10, 2.0
#: What a vertex may lie above the highest return and below the lowest [m], beside what the spacing explains.
_ABOVE, _BELOW = 0.3, 1.0


def settle_planes(
    faces: list[RoofFacePatch], points: NDArray[np.float64], spacing: float
) -> list[RoofFacePatch]:
    """
    Give faces that do not fit their points, or reach beyond all points, a plane of their own.

    A plane is good where its points are. Beyond them it may rise above everything that was seen; such a
    face gets the least-squares plane of the points over it, or lies flat at their median.

    Parameters
    ----------
    faces : list of RoofFacePatch
    points : ndarray of shape (n_points, 3)
        The building's points [m].
    spacing : float
        Point spacing [m].

    """
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    return [_settled(face, points, low, high, spacing) for face in faces]


def _settled(
    face: RoofFacePatch, points: NDArray[np.float64], low: float, high: float, spacing: float
) -> RoofFacePatch:
    """
    Return the face with the first plane that fits and stays within limits.

    """
    own = points[face.rows]
    if _is_good(face.plane, face, own, low, high, spacing):
        return face
    if len(own) >= _MIN_POINTS:
        plane = _least_squares(own)
        if np.hypot(*plane[:2]) <= _MAX_RISE and _is_good(plane, face, own, low, high, spacing):
            return replace(face, plane=plane)
    if len(own):
        return replace(face, plane=np.array([0.0, 0.0, np.median(own[:, 2])]))
    elevation = np.clip(_elevations(face.plane, face.rings[0]).mean(), low, high)
    return replace(face, plane=np.array([0.0, 0.0, elevation]))


def _is_good(
    plane: NDArray[np.float64],
    face: RoofFacePatch,
    own: NDArray[np.float64],
    low: float,
    high: float,
    spacing: float,
) -> bool:
    """
    Whether a plane fits a face's points and keeps within the heights that were seen.

    """
    slack = np.hypot(*plane[:2]) * spacing
    z = np.concatenate([_elevations(plane, ring) for ring in face.rings])
    if z.max() > high + _ABOVE + slack or z.min() < low - _BELOW - slack:
        return False
    if not len(own):
        return True
    return bool(np.median(np.abs(own[:, 2] - _elevations(plane, own))) <= _MAX_MEDIAN_MISFIT + 0.5 * slack)


def _elevations(plane: NDArray[np.float64], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return a plane's elevations at places.

    """
    return np.asarray(xy[:, 0] * plane[0] + xy[:, 1] * plane[1] + plane[2])


def _least_squares(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the plane z = a·x + b·y + c with the least vertical misfit; flat where the points lie on a line.

    """
    centre = points.mean(axis=0)
    offsets = points - centre
    a, b = np.linalg.lstsq(offsets[:, :2], offsets[:, 2], rcond=1e-3)[0]
    return np.array([a, b, centre[2] - a * centre[0] - b * centre[1]])


def parts_of_one_height(faces: list[RoofFacePatch], min_step: float) -> NDArray[np.int64]:
    """
    Number the parts of a roof: faces that meet, or are parted by a low step only, belong together.

    Parameters
    ----------
    faces : list of RoofFacePatch
        A coverage whose faces share whole edges or pieces of them.
    min_step : float
        Mean step along a common border that makes two parts of two faces [m].

    Returns
    -------
    ndarray of shape (n_faces,), int64
        From 0.

    """
    polygons = np.array([face.polygon for face in faces], dtype=object)
    one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    one, other = one[one < other], other[one < other]
    low = [_mean_step(faces[a], faces[b]) < min_step for a, b in zip(one, other, strict=True)]
    roots = sets_of_pairs(len(faces), one[low], other[low])
    return np.unique(roots, return_inverse=True)[1].reshape(-1)


def _mean_step(one: RoofFacePatch, other: RoofFacePatch) -> float:
    """
    Return the mean difference of elevation along the border of two faces [m], infinite without a border.

    """
    border = shapely.intersection(one.polygon, other.polygon)
    lines = [part for part in shapely.get_parts(border) if part.geom_type == "LineString"]
    if not lines:
        return np.inf
    along = np.concatenate([shapely.get_coordinates(line.segmentize(1.0)) for line in lines])
    return float(np.mean(np.abs(_elevations(one.plane, along) - _elevations(other.plane, along))))
