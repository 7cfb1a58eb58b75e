"""Heights of roof faces that the points bear out, and the parts of a roof that share one height."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.stages.building_model.roof_face import RoofFacePatch, open_rings

#: A face whose points lie farther off in the middle than this gets a plane of its own [m].
_MAX_MEDIAN_MISFIT = 0.25
#: A face of its own may slope if it has so many points, and rises by no more than this [m/m].
_MIN_POINTS, _MAX_RISE = 10, 2.0
#: A face smaller than this [m²] with points all over reaches no farther beyond their heights than this [m],
#: beside what the spacing explains: else it stands out as a blade.
_SMALL, _STRAY = 5.0, 0.3
#: A face of this mean width or less is narrow [spacings].
_NARROW = 1.5
#: What a vertex may lie above the highest return and below the lowest [m], beside what the spacing explains.
_ABOVE, _BELOW = 0.3, 1.0


@dataclass(frozen=True)
class Limits:
    """
    Elevations that a roof keeps to.

    Attributes
    ----------
    low, high : float
        Of the lowest and the highest return, with a margin [m].
    per_rise : float
        Margin beyond for each unit of slope: a roof runs on for one spacing beyond its points [m].
    """

    low: float
    high: float
    per_rise: float

    @classmethod
    def of(cls, points: FloatArray, spacing: float) -> Limits:
        """Return the limits of a building's points."""
        return cls(float(points[:, 2].min()) - _BELOW, float(points[:, 2].max()) + _ABOVE, spacing)

    def excess(self, planes: FloatArray, xy: FloatArray) -> FloatArray:
        """Return how far planes, shape (n, 3), lie beyond the limits at places, shape (n, 2) [m]."""
        z = np.einsum("ij,ij->i", planes[:, :2], xy) + planes[:, 2]
        beyond = np.maximum(z - self.high, self.low - z) - self.per_rise * np.hypot(*planes[:, :2].T)
        return np.maximum(beyond, 0.0)


def fit_face_planes(faces: list[RoofFacePatch], points: FloatArray, spacing: float) -> list[RoofFacePatch]:
    """
    Give faces that do not fit their points a plane of their own, and cut off what reaches beyond all points.

    A plane is good where its points are. Beyond them it may rise above everything that was seen: there the
    roof is level, at the height of the highest return.

    Parameters
    ----------
    faces : list of RoofFacePatch
    points : ndarray of shape (n_points, 3)
        The building's points [m].
    spacing : float
        Point spacing [m].
    """
    limits = Limits.of(points, spacing)
    fitting = [_fitted(face, points[face.rows], spacing) for face in faces]
    return [piece for face in fitting for piece in _within(face, points, limits)]


def _fitted(face: RoofFacePatch, own: FloatArray, spacing: float) -> RoofFacePatch:
    """Return a face with the first plane that fits its points."""
    if not len(own) or _suits(face.plane, face, own, spacing):
        return face
    if len(own) >= _MIN_POINTS:
        plane = _least_squares(own)
        if np.hypot(*plane[:2]) <= _MAX_RISE and _suits(plane, face, own, spacing):
            return replace(face, plane=plane)
    return replace(face, plane=np.array([0.0, 0.0, np.median(own[:, 2])]))


def _suits(plane: FloatArray, face: RoofFacePatch, own: FloatArray, spacing: float) -> bool:
    """
    Whether a plane fits a face's points and, if the face is small and full of them, keeps to their heights.
    """
    if not _fits(plane, own, spacing):
        return False
    polygon = face.polygon
    if polygon.area > _SMALL or len(own) * spacing**2 < 0.5 * polygon.area:
        return True
    z = _elevations(plane, np.concatenate(face.rings))
    # Points over a face one or two of them wide tell nothing of its slope.
    is_narrow = 2.0 * polygon.area < _NARROW * spacing * polygon.length
    slack = _STRAY + (0.0 if is_narrow else 2.0 * spacing * float(np.hypot(*plane[:2])))
    return bool(z.max() <= own[:, 2].max() + slack and z.min() >= own[:, 2].min() - slack)


def _fits(plane: FloatArray, own: FloatArray, spacing: float) -> bool:
    """Whether half of a face's points are near its plane."""
    misfit = np.abs(own[:, 2] - _elevations(plane, own))
    return bool(np.median(misfit) <= _MAX_MEDIAN_MISFIT + 0.5 * spacing * np.hypot(*plane[:2]))


def _within(face: RoofFacePatch, points: FloatArray, limits: Limits) -> list[RoofFacePatch]:
    """
    Return a face, or its pieces where it reaches beyond the limits: the part between them, and level ones.
    """
    corners = np.concatenate(face.rings)
    if not limits.excess(np.tile(face.plane, (len(corners), 1)), corners).any():
        return [face]
    slack = limits.per_rise * float(np.hypot(*face.plane[:2]))
    levels = limits.low - slack, limits.high + slack
    own = _elevations(face.plane, points[face.rows])
    whole, pieces = face.polygon, []
    bands = ((-np.inf, levels[0]), levels, (levels[1], np.inf))
    for (low, high), level in zip(bands, (levels[0], None, levels[1]), strict=True):
        plane = face.plane if level is None else np.array([0.0, 0.0, level])
        band = shapely.intersection(whole, _between(face, low, high), grid_size=GRID)
        rows = face.rows[(own > low) & (own <= high)]
        parts = [part for part in shapely.get_parts(band) if part.area > 0.0]
        for number, part in enumerate(sorted(parts, key=lambda one: -one.area)):
            pieces.append(RoofFacePatch(open_rings(part), plane, rows if number == 0 else rows[:0]))
    return pieces or [face]


def _between(face: RoofFacePatch, low: float, high: float) -> shapely.Polygon:
    """Return a strip in plan that holds all of a face whose plane lies between two elevations."""
    rise = float(np.hypot(*face.plane[:2]))
    uphill = face.plane[:2] / rise
    along = np.array([-uphill[1], uphill[0]])
    centre = np.concatenate(face.rings).mean(axis=0)
    reach = 2.0 * float(np.hypot(*(np.concatenate(face.rings) - centre).T).max()) + 1.0
    start = float(centre @ face.plane[:2] + face.plane[2])
    a, b = (np.clip((z - start) / rise, -reach, reach) for z in (low, high))
    corners = [(a, -reach), (b, -reach), (b, reach), (a, reach)]
    return shapely.Polygon([centre + u * uphill + v * along for u, v in corners])


def _elevations(plane: FloatArray, xy: FloatArray) -> FloatArray:
    return np.asarray(xy[:, 0] * plane[0] + xy[:, 1] * plane[1] + plane[2])


def _least_squares(points: FloatArray) -> FloatArray:
    """
    Return the plane z = a·x + b·y + c with the least vertical misfit; flat where the points lie on a line.
    """
    centre = points.mean(axis=0)
    offsets = points - centre
    a, b = np.linalg.lstsq(offsets[:, :2], offsets[:, 2], rcond=1e-3)[0]
    return np.array([a, b, centre[2] - a * centre[0] - b * centre[1]])


def parts_of_one_height(faces: list[RoofFacePatch], min_step: float) -> IntArray:
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
