"""The planes of a roof, each by itself: sums over its points, least squares, and what a change costs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS

#: Normals are taken for no more level than this when elevations are asked for: a wall has none.
_LEAST_VERTICAL = 1e-6


@dataclass(frozen=True, eq=False)
class RoofPlane:
    """One plane of a roof."""

    normal: FloatArray  #: unit normal, pointing upwards, shape (3,)
    #: Mean of the plane's points, map frame [m]; if the plane was adjusted, its own place above or below,
    #: shape (3,).
    centroid: FloatArray
    rms: float  #: root mean square of the points' orthogonal distances [m]
    n_points: int  #: number of points
    #: Of a, b and c of z = a (x − x₀) + b (y − y₀) + c about the centroid x₀, y₀, shape (3, 3).
    covariance: FloatArray

    @property
    def gradient(self) -> FloatArray:
        """By how much the plane rises towards x and y [m/m]."""
        return np.array(self.equation[:2])

    @property
    def equation(self) -> tuple[float, float, float]:
        """a, b, c of z = a x + b y + c."""
        (nx, ny, nz), (x, y, z) = self.normal.tolist(), self.centroid.tolist()
        a, b = -nx / max(nz, _LEAST_VERTICAL), -ny / max(nz, _LEAST_VERTICAL)
        return a, b, z - a * x - b * y

    @property
    def is_wall(self) -> bool:
        """Whether the plane is too steep for a roof."""
        return float(self.normal[2]) <= _LEAST_UPRIGHT

    def elevation(self, xy: FloatArray) -> FloatArray:
        """Elevation of the plane [m] at positions of shape (n, 2)."""
        return np.asarray(self.centroid[2] + (xy - self.centroid[:2]) @ self.gradient)

    def elevation_sigma(self, xy: FloatArray) -> FloatArray:
        """Standard deviation of `elevation` [m] at positions of shape (n, 2)."""
        place = np.ones((len(xy), 3))
        place[:, :2] = xy - self.centroid[:2]
        return np.sqrt(np.einsum("ni,ij,nj->n", place, self.covariance, place))


def without_gaps(plane_id: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Number planes from 1 in their order; 0 stays."""
    counts = np.bincount(plane_id, minlength=1)
    counts[0] = 1
    number = np.flatnonzero(counts)
    if number[-1] == len(number) - 1:
        return plane_id
    new = np.zeros(len(counts), dtype=np.uint16)
    new[number] = np.arange(len(number))
    return new[plane_id]


#: Bits of an integer that a sum of products may take.
_SUM_BITS = 62
#: Coordinates are rounded to 2^-13 m, an eighth of a millimetre, unless the building is enormous.
_FINEST_BITS = 13


class PlaneMoments(NamedTuple):
    """Sums of coordinates and their products about the building's centre, plane by plane."""

    centre: FloatArray  #: middle of the points' bounding box [m], shape (3,)
    sums: FloatArray  #: n, Σx, Σy, Σz, Σxx, Σxy, Σxz, Σyy, Σyz, Σzz about the centre, shape (n_planes, 10)


class PlaneSums:
    """
    Sums over the points of planes, numbered from 1, about one centre [m]; more may come, in any order.

    Coordinates are counted in whole fractions of a metre, 2 to the power of `bits`: sums of integers do not
    depend on their order.
    """

    def __init__(self, centre: FloatArray, n_planes: int, bits: int = _FINEST_BITS) -> None:
        self._centre, self._unit = centre, 2.0**bits
        self._sums = np.zeros((n_planes, N_MOMENTS), dtype=np.int64)

    def add(self, points: FloatArray, plane_id: NDArray[np.uint16]) -> None:
        """Add points, shape (n, 3) [m], each to its plane; plane 0 is none."""
        _add_points(points, plane_id, self._centre, self._unit, self._sums)

    @property
    def moments(self) -> PlaneMoments:
        """The sums so far."""
        scale = np.array([1.0, *[1 / self._unit] * 3, *[1 / self._unit**2] * 6])
        return PlaneMoments(self._centre, self._sums * scale)


def plane_moments(points: FloatArray, plane_id: NDArray[np.uint16], n_planes: int) -> PlaneMoments:
    """Sum the coordinates of each plane's points, and their products; plane 0 is none."""
    if not len(points):
        return PlaneMoments(np.zeros(3), np.zeros((n_planes, N_MOMENTS)))
    low, high = extent_of(points)
    half = max(float((high - low).max()), 1e-3)
    bits = min(_FINEST_BITS, int((_SUM_BITS - math.log2(len(points))) / 2 - math.log2(half)))
    sums = PlaneSums(0.5 * (low + high), n_planes, bits)
    sums.add(points, plane_id)
    return sums.moments


@kernel
def _add_points(points, plane_id, centre, unit, sums):  # type: ignore[no-untyped-def]
    for i in range(len(points)):
        k = np.int64(plane_id[i]) - 1
        if k < 0:
            continue
        x = np.int64(np.rint((points[i, 0] - centre[0]) * unit))
        y = np.int64(np.rint((points[i, 1] - centre[1]) * unit))
        z = np.int64(np.rint((points[i, 2] - centre[2]) * unit))
        moments = 1, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z
        for moment in range(N_MOMENTS):
            sums[k, moment] += moments[moment]


def centroids_and_scatters(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return planes' centroids about the centre, (n, 3), and scatter matrices about these, (n, 3, 3)."""
    n = np.maximum(sums[:, :1], 1.0)
    mean = sums[:, 1:4] / n
    products = sums[:, np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])]
    return mean, products - n[:, :, None] * mean[:, :, None] * mean[:, None, :]


#: Steeper planes are walls: they stay as they are [deg].
STEEPEST_DEG = 87.0
#: Points whose second axis is shorter than this share of the first lie on a line: their plane is level.
_LINE = 1e-3
#: Weight of a plane's own slope beside its points' [m²]: keeps covariances of lines and points finite.
_PRIOR = 1e-4
_LEAST_UPRIGHT = math.cos(math.radians(STEEPEST_DEG))


class FreePlanes(NamedTuple):
    """Planes z = a x + b y + c about the building's centre."""

    moments: PlaneMoments  #: the planes' points
    mean: FloatArray  #: centroids about the centre [m], shape (n_planes, 3)
    scatter: FloatArray  #: scatter matrices about the centroids [m²], shape (n_planes, 3, 3)
    normals: FloatArray  #: unit normals, pointing upwards, shape (n_planes, 3)
    rms: FloatArray  #: root mean square of the orthogonal distances [m], shape (n_planes,)
    coefficients: FloatArray  #: a, b, c, shape (n_planes, 3)
    #: Of a, b, c about each plane's centroid, see `plane_covariances`, shape (n_planes, 3, 3).
    covariance: FloatArray
    roof: BoolArray  #: which are roofs: not a wall, and not without points, shape (n_planes,)

    @property
    def counts(self) -> FloatArray:
        """Number of points of each plane, at least 1."""
        return np.maximum(self.moments.sums[:, 0], 1.0)


def free_planes(moments: PlaneMoments) -> FreePlanes:
    """Fit every plane to its points by orthogonal least squares."""
    mean, scatter = centroids_and_scatters(moments.sums)
    values, axes = np.linalg.eigh(scatter)
    is_line = (values[:, 1] <= _LINE**2 * values[:, 2]) | (moments.sums[:, 0] < 3)
    normals = np.where(is_line[:, None], (0.0, 0.0, 1.0), axes[:, :, 0])
    normals *= np.where(normals[:, 2:] < 0.0, -1.0, 1.0)
    upright = normals[:, 2]
    square = np.einsum("ki,kij,kj->k", normals, scatter, normals)
    rms = np.sqrt(np.maximum(square, 0.0) / np.maximum(moments.sums[:, 0], 1.0))
    gradients = -normals[:, :2] / np.maximum(upright, _LEAST_VERTICAL)[:, None]
    coefficients = np.column_stack([gradients, mean[:, 2] - (gradients * mean[:, :2]).sum(axis=1)])
    covariance = plane_covariances(moments.sums[:, 0], scatter, upright, rms)
    roof = (moments.sums[:, 0] > 0.0) & (upright > _LEAST_UPRIGHT)
    return FreePlanes(moments, mean, scatter, normals, rms, coefficients, covariance, roof)


#: Points of a roof scatter by no less [m]: noise of the range and of the survey's pose.
_LEAST_NOISE = 0.01
#: Neighbouring points share noise and what the roof itself is uneven by: of so many one counts.
POINTS_SHARED = 2.2


def plane_covariances(
    counts: FloatArray, scatter: FloatArray, upright: FloatArray, rms: FloatArray
) -> FloatArray:
    """
    Return the covariances of a, b, c of planes z = a (x − x₀) + b (y − y₀) + c about their centroids.

    Least squares: the variance of a point along z, from the residuals with n − 3 degrees of freedom, times
    the inverse normal matrix (Förstner and Wrobel 2016, 4.2), greater by the number of neighbouring points
    that share an error. Counts and `upright`, z of the unit normal, are (n,), scatter matrices about the
    centroids (n, 3, 3) [m²], `rms` (n,) [m]; returned are (n, 3, 3) [1, m, m²].
    """
    freedom = counts / np.maximum(counts - 3.0, 1.0)
    variance = (
        POINTS_SHARED
        * np.maximum(rms**2 * freedom, _LEAST_NOISE**2)
        / np.maximum(upright, _LEAST_VERTICAL) ** 2
    )
    xx, xy, yy = scatter[:, 0, 0] + _PRIOR, scatter[:, 0, 1], scatter[:, 1, 1] + _PRIOR
    determinant = np.maximum(xx * yy - xy * xy, _PRIOR**2)
    found = np.zeros((len(counts), 3, 3))
    found[:, 0, 0], found[:, 1, 1] = variance * yy / determinant, variance * xx / determinant
    found[:, 0, 1] = found[:, 1, 0] = -variance * xy / determinant
    found[:, 2, 2] = variance / np.maximum(counts, 1.0)
    return found


def fitted_planes(points: FloatArray, plane_id: NDArray[np.uint16]) -> tuple[RoofPlane, ...]:
    """Fit every plane to its points by orthogonal least squares, each by itself, numbered as in `adjust`."""
    free = free_planes(plane_moments(points, plane_id, int(plane_id.max(initial=0))))
    return adjusted_planes(free, free.coefficients, free.covariance)


def adjusted_planes(
    free: FreePlanes, coefficients: FloatArray, covariances: FloatArray
) -> tuple[RoofPlane, ...]:
    """Return the planes after the adjustment; walls stay as they were fitted."""
    roof, normals, places = free.roof, free.normals.copy(), free.mean.copy()
    a, b, c = coefficients[roof].T
    normals[roof] = np.column_stack([-a, -b, np.ones(len(a))]) / np.sqrt(a * a + b * b + 1.0)[:, None]
    places[roof, 2] = a * places[roof, 0] + b * places[roof, 1] + c
    off = (normals * (free.mean - places)).sum(axis=1)
    square = np.einsum("ki,kij,kj->k", normals, free.scatter, normals) / free.counts + off**2
    rms = np.sqrt(np.maximum(square, 0.0)).tolist()
    columns = normals, places + free.moments.centre, rms, map(int, free.moments.sums[:, 0]), covariances
    return tuple(RoofPlane(*each) for each in zip(*columns, strict=True))
