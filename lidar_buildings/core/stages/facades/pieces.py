"""Pieces of straight lines and arcs in patches of upright points: where walls may stand, and how far."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.facades.curves import Curve, fit_curve
from lidar_buildings.core.surfaces.eigenfeatures import PLANE_CANDIDATES, eigen_features
from lidar_buildings.core.surfaces.surface_patches import smooth_patches

Floats = NDArray[np.float64]

#: One point a voxel stands for all: no wall is told better by more, and passes count alike [m].
VOXEL = 0.1
#: Heights are multiplied by this: the beams of a spinning scanner lie farther apart than the points on one.
SQUASH = 0.35
#: Radii of neighbourhoods, of which the first counts that has enough points and is no rougher than a wall:
#: near the street, 40 m off, and where poses are noisy [m].
RADII = (0.3, 0.6, 1.2)
MIN_NEIGHBOURS = 12
#: Largest upward part of the normal of an upright surface, with squashed heights: a lean of 11°.
MAX_UPWARD = 0.5
#: Largest roughness of a neighbourhood of each radius: a wall's noise, and no foliage [m].
MAX_ROUGHNESS = (0.06, 0.09, 0.14)
#: Neighbours farther apart are not linked [m].
MAX_STEP = 0.6
#: Points of one wall: their directions differ at most by this, and each lies so near the other's plane [m].
MAX_ANGLE_DEG, MAX_OFFSET = 20.0, 0.1
#: Points of a piece, at least: 1 m² of wall at 40 m.
MIN_POINTS = 12
#: Length of a piece, at least [m].
MIN_LENGTH = 0.5
#: Widest gap within a piece [m]: wider ones are closed when pieces are joined.
MAX_GAP = 1.0
#: Points on a curve lie within so many σ of the patch's roughness, and of this at least [m].
ON_SIGMAS, MIN_TOLERANCE = 3.0, 0.05
#: ... and their surface goes as the curve does: cosine of 20°.
MIN_COSINE = 0.94
#: Points that propose a line each, and those that propose a circle by two.
N_LINES, N_CIRCLES = 64, 16
#: A circle has to explain so many times the points of a line, and its radius is within [m].
CIRCLE_GAIN, CIRCLE_RADII = 1.25, (1.0, 80.0)
#: Pieces of a patch, at most; what is left is bits.
MAX_PIECES = 40


@dataclass(frozen=True, eq=False)
class UprightPoints:
    """Points that stand for the upright surfaces of a cloud, patch by patch."""

    points: Floats  #: [m], shape (n_points, 3)
    normals: Floats  #: of the surface in plan, either way, shape (n_points, 2)
    roughness: Floats  #: root mean square distance of neighbours from their plane [m], shape (n_points,)
    first: NDArray[np.intp]  #: patch k holds the points first[k] to first[k + 1] (exclusive)


def thinned(points: Floats) -> Floats:
    """Return the lowest point of each voxel, the same ones whatever the order of the points."""
    grid = sort_by_cell(points, VOXEL)
    layer = np.floor(grid.points[:, 2] / grid.size)
    is_first = np.ones(len(layer), dtype=bool)
    is_first[1:] = layer[1:] != layer[:-1]
    is_first[grid.first[:-1]] = True
    return grid.points[is_first]


def upright_points(points: Floats) -> UprightPoints:
    """
    Find the points of a cloud on upright surfaces, and link them to smooth patches.

    The shape of each point's neighbourhood, in which heights are squashed, tells the direction of its
    surface.
    """
    squashed = thinned(points) * (1.0, 1.0, SQUASH)
    normals, roughness, radius = _shapes(squashed)
    rows = np.flatnonzero((np.abs(normals[:, 2]) <= MAX_UPWARD) & (radius > 0.0))
    normals = normals[rows] * (1.0, 1.0, 0.0)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    columns = sort_by_cell(squashed[rows], MAX_STEP / 2.0)
    rows, normals = rows[columns.rows], normals[columns.rows]
    reach = np.minimum(radius[rows], MAX_STEP)
    label = smooth_patches(columns, normals, reach, max_angle_deg=MAX_ANGLE_DEG, max_offset=MAX_OFFSET)
    order = np.argsort(label, kind="stable")
    first = np.append(0, np.cumsum(np.bincount(label)))
    rows = rows[order]
    return UprightPoints(squashed[rows] / (1.0, 1.0, SQUASH), normals[order, :2], roughness[rows], first)


def _shapes(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Return normal, roughness and radius of the smallest neighbourhoods that may be of a surface, else 0."""
    normals, roughness, radius = np.zeros((len(points), 3)), np.zeros(len(points)), np.zeros(len(points))
    left = np.arange(len(points))
    for step, limit in zip(RADII, MAX_ROUGHNESS, strict=True):
        shape = eigen_features(points[left], [step], max_candidates=PLANE_CANDIDATES)
        is_plain = (shape.n_neighbours >= MIN_NEIGHBOURS) & (shape.roughness <= limit)
        own = left[is_plain]
        normals[own], roughness[own] = shape.normals[is_plain], shape.roughness[is_plain]
        radius[own] = step
        left = left[~is_plain]
    return normals, roughness, radius


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of a curve with upright points on it."""

    curve: Curve
    first: float  #: places on the curve where it begins and ends [m]
    last: float
    n_points: int  #: that stand for it, one a voxel
    roughness: float  #: of its patch: σ of its points, not more than twice as wide [m]

    @property
    def length(self) -> float:
        """Length along the curve [m]."""
        return self.last - self.first


def pieces_of(upright: UprightPoints) -> list[Piece]:
    """Divide each patch into straight and round pieces, those with most points first."""
    found: list[Piece] = []
    for begin, end in zip(upright.first[:-1], upright.first[1:], strict=True):
        if end - begin >= MIN_POINTS:
            own = slice(begin, end)
            found += _divided(upright.points[own], upright.normals[own], upright.roughness[own])
    return sorted(found, key=lambda one: (-one.n_points, *one.curve.origin))


def _divided(points: Floats, normals: Floats, roughness: Floats) -> Iterator[Piece]:
    """Yield the pieces of one patch: again and again the curve that most of what is left lies on."""
    xy = np.ascontiguousarray(points[:, :2])
    sigma = float(np.median(roughness))
    tolerance = max(ON_SIGMAS * sigma, MIN_TOLERANCE)
    left = np.arange(len(xy))
    for _ in range(MAX_PIECES):
        if len(left) < MIN_POINTS:
            return
        curve = _best_curve(xy[left], normals[left], tolerance)
        curve, _ = fit_curve(xy[left], curve, tolerance / 2.0)
        is_on, place = _on(curve, xy[left], normals[left], tolerance)
        if np.count_nonzero(is_on) < MIN_POINTS:
            return
        taken = np.flatnonzero(is_on)
        taken = taken[np.argsort(place[taken], kind="stable")]
        ends = np.flatnonzero(np.diff(place[taken]) > MAX_GAP) + 1
        for run in np.split(taken, ends):
            first, last = place[run[0]], place[run[-1]]
            if len(run) >= MIN_POINTS and last - first >= MIN_LENGTH:
                yield Piece(curve, float(first), float(last), len(run), sigma)
        left = np.delete(left, taken)


def _on(curve: Curve, xy: Floats, normals: Floats, tolerance: float) -> tuple[NDArray[np.bool_], Floats]:
    """Tell which points lie on a curve and go as it does, and at which places."""
    place, offset = curve.seen_from(xy)
    is_on = np.abs(offset) <= tolerance
    is_on[is_on] = np.abs((curve.normals_at(place[is_on]) * normals[is_on]).sum(axis=1)) >= MIN_COSINE
    return is_on, place


def _best_curve(xy: Floats, normals: Floats, tolerance: float) -> Curve:
    """Return the line or circle through some of the points and their directions that most points lie on."""
    asked = np.linspace(0, len(xy) - 1, min(len(xy), N_LINES)).astype(np.int64)
    found = np.empty(5)
    _find_best(xy, normals, asked, max(1, len(asked) // N_CIRCLES), tolerance, found)
    return Curve(found[:2].copy(), found[2:4].copy(), float(found[4]))


@kernel
def _find_best(xy, normals, asked, stride, tolerance, found):  # type: ignore[no-untyped-def]
    """Write origin, direction and bend of the best curve to `found`."""
    most, one = -1, np.empty(5)
    for k in asked:
        one[0], one[1], one[2], one[3], one[4] = xy[k, 0], xy[k, 1], normals[k, 1], -normals[k, 0], 0.0
        n_on = _n_on(xy, normals, one, tolerance, most)
        if n_on > most:
            most, found[:] = n_on, one
    if most >= len(xy) / CIRCLE_GAIN:
        return
    most = int(most * CIRCLE_GAIN)
    for a in range(0, len(asked), stride):
        for b in range(a + stride, len(asked), stride):
            if _circle(xy[asked[a]], normals[asked[a]], xy[asked[b]], normals[asked[b]], one):
                n_on = _n_on(xy, normals, one, tolerance, most)
                if n_on > most:
                    most, found[:] = n_on, one


@kernel
def _n_on(xy, normals, curve, tolerance, most):  # type: ignore[no-untyped-def]
    """Count the points on a curve that go as it does; of a curve with no more than `most` only some."""
    x, y, direction_x, direction_y, bend = curve
    side = 1.0 if bend > 0.0 else -1.0
    n_on, n = 0, len(xy)
    for i in range(n):
        away_x, away_y = xy[i, 0] - x, xy[i, 1] - y
        v = away_y * direction_x - away_x * direction_y
        normal_x, normal_y = -direction_y, direction_x
        if bend != 0.0:
            u, inward = away_x * direction_x + away_y * direction_y, 1.0 / abs(bend) - side * v
            far = math.sqrt(u * u + inward * inward)
            v = 1.0 / abs(bend) - far
            along, across = side * u / far, inward / far
            normal_x = -across * direction_y - along * direction_x
            normal_y = across * direction_x - along * direction_y
        if abs(v) <= tolerance and abs(normal_x * normals[i, 0] + normal_y * normals[i, 1]) >= MIN_COSINE:
            n_on += 1
        elif n_on + n - 1 - i <= most:
            return n_on
    return n_on


@kernel
def _circle(a, normal_a, b, normal_b, found):  # type: ignore[no-untyped-def]
    """Write the circle through two points at right angles to their normals to `found`, if there is one."""
    cross = normal_a[0] * normal_b[1] - normal_a[1] * normal_b[0]
    if abs(cross) < 1e-3:
        return False
    reach = ((b[0] - a[0]) * normal_b[1] - (b[1] - a[1]) * normal_b[0]) / cross
    x, y = a[0] + reach * normal_a[0], a[1] + reach * normal_a[1]
    radius_a, radius_b = math.hypot(a[0] - x, a[1] - y), math.hypot(b[0] - x, b[1] - y)
    radius = 0.5 * (radius_a + radius_b)
    if not CIRCLE_RADII[0] <= radius <= CIRCLE_RADII[1] or abs(radius_a - radius_b) > 0.1 * radius:
        return False
    out_x, out_y = (a[0] - x) / radius_a, (a[1] - y) / radius_a
    found[0], found[1] = x + radius * out_x, y + radius * out_y
    found[2], found[3], found[4] = -out_y, out_x, 1.0 / radius
    return True
