"""How sure a model is: standard deviations of the corners, planes and walls of its roof."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.solids.shell import ROOF_SURFACE, WALL_SURFACE, Solid, cross
from lidar_buildings.core.solids.triangulation import FaceArrays, face_arrays
from lidar_buildings.core.stages.roof_topology.result import RoofTopology
from lidar_buildings.core.surfaces.roof_planes import RoofPlane

# Chosen on virtual roofs of seeds 1 to 8, judged on others: `bench.models.precision`.
#: A traced wall: what all of it is off by, and each of the rows of points that end at it [spacings].
_WALL_BIAS, _WALL_EACH = 0.023, 0.31
#: A wall between roofs, likewise.
_STEP_BIAS, _STEP_EACH = 0.036, 0.31
#: This share of the rows, the outermost ones, ends so far inside of a roof's edge [spacings].
_OUTERMOST, _SHORT = 0.1, 0.094
#: By how much the variance of a wall's middle grows towards the square of the distance from it [lengths].
_LEVER = 3.0
#: Points within so many spacings of a wall tell where it is.
_REACH = 3.0
#: A wall that was given holds to this [m].
_GIVEN = 1e-3
#: Standard deviation along what nothing fixes [spacings].
_LOOSE = 1.0

#: A face lies in a plane that is so near at all its corners [m]; one in none is off by this [m].
_SAME_PLANE, NO_PLANE = 0.02, 0.3
#: A wall stands on the outline if its middle is so near [m].
_ON_OUTLINE = 0.02
#: Walls fix a corner in plan that turn by more: square of the sine of 15°.
TURN = 0.067
#: Keeps divisions by lengths and areas of 0 finite.
_LEAST = 1e-9
#: Digits of standard deviations [m].
DECIMALS = 3


class Sampling(NamedTuple):
    """The points that a model was made of."""

    points: FloatArray  #: rising by y [m], shape (n_points, 3)
    spacing: float  #: [m]
    #: By how much the roof's edge is thought to lie outside of walls drawn through the points, 0 where they
    #: were moved there; None if the outline was given [m].
    wall_bias: float | None


class Conditions(NamedTuple):
    """Planes that corners lie on, one of one corner a row."""

    vertex: IntArray  #: row of the corner, shape (n,)
    normal: FloatArray  #: of a wall, of length 1, or (-a, -b, 1) of z = a x + b y + c, shape (n, 3)
    sigma: FloatArray  #: of a wall across, of a roof's plane along z at the corner [m], shape (n,)
    is_wall: BoolArray  #: shape (n,)


def corner_covariances(conditions: Conditions, n_vertices: int, loose: float) -> FloatArray:
    """
    Return the covariances of corners [m²], shape (n_vertices, 3, 3).

    A corner is the least-squares intersection of the planes that it lies on: Σ = (Σ n nᵀ / σ²)⁻¹ (Förstner
    and Wrobel 2016, 10.5; Mikhail 1976). Where two walls fix it in plan its height is the mean of its roof
    planes': so it was built. More than three planes count as three, as they share what is wrong. Along what
    nothing fixes the standard deviation is `loose` [m].
    """
    vertex, normal, sigma, is_wall = conditions
    u, v = normal[is_wall, :2].T
    turns, of_roofs = np.zeros((n_vertices, 3)), np.zeros((n_vertices, 5))
    np.add.at(turns, vertex[is_wall], np.column_stack([u * u, u * v, v * v]))
    is_fixed = turns[:, 0] * turns[:, 2] - turns[:, 1] ** 2 > TURN
    planes = np.column_stack([normal, sigma**2, np.ones(len(sigma))])[~is_wall]
    np.add.at(of_roofs, vertex[~is_wall], planes)
    middle = np.flatnonzero(is_fixed & (of_roofs[:, 4] > 0.0))
    mean = of_roofs[middle] / of_roofs[middle, 4:]
    used = is_wall | ~is_fixed[vertex]
    vertex = np.concatenate([vertex[used], middle])
    normal = np.concatenate([normal[used], mean[:, :3]])
    variance = np.concatenate([sigma[used] ** 2, mean[:, 3]])
    variance *= np.maximum(np.bincount(vertex, minlength=n_vertices) / 3.0, 1.0)[vertex]
    information = np.tile(np.eye(3) / loose**2, (n_vertices, 1, 1))
    np.add.at(information, vertex, normal[:, :, None] * (normal / variance[:, None])[:, None, :])
    return np.asarray(np.linalg.inv(information))


def wall_variances(walls: FloatArray, is_outer: BoolArray, sampling: Sampling) -> FloatArray:
    """
    Return the variances of walls across [m²]: of all of it, and of its middle besides, shape (n_walls, 2).

    A wall is where rows of points end, each anywhere within a spacing: it is the surer the more rows end at
    it, and the less their outermost tenth ends elsewhere than at a wall there. The bias is not in them: it
    is common to all walls. `walls` are seen from above with the building to their left, shape
    (n_walls, 2, 2) [m].
    """
    points, spacing, bias = sampling
    n, outermost = _ends_of_rows(walls, points, spacing).T
    of_all = np.where(is_outer, _WALL_BIAS, _STEP_BIAS) * spacing
    of_each = np.where(is_outer, _WALL_EACH, _STEP_EACH) * spacing
    off = np.where(is_outer, outermost + (bias or 0.0) - _SHORT * spacing, 0.0)
    variances = np.column_stack([of_all**2 + off**2, of_each**2 / n])
    variances[is_outer & (bias is None)] = _GIVEN**2, 0.0
    return variances


def outline_variances(outline: Outline, sampling: Sampling, beside: FloatArray | None) -> FloatArray | None:
    """
    Return the variances of an outline's walls across but for what is common to all, shape (n_walls,) [m²].

    Walls nearer than a spacing to those of other buildings, `beside`, stay: they have none. None if the
    outline was not traced but given.
    """
    if sampling.wall_bias is None:
        return None
    walls = ring_walls(outline.rings)
    variances = wall_variances(walls, np.ones(len(walls), np.bool_), sampling).sum(axis=1)
    if beside is not None and len(beside):
        others = shapely.multilinestrings(beside)
        variances[shapely.dwithin(shapely.linestrings(walls), others, sampling.spacing)] = 0.0
    return variances


@kernel
def _ends_of_rows(walls, points, spacing):  # type: ignore[no-untyped-def]
    """Return how many rows of points end at each wall, and how far inside the outermost tenth does [m]."""
    found, reach = np.zeros((len(walls), 2)), _REACH * spacing
    for w in range(len(walls)):
        ax, ay, bx, by = walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]
        length = max(math.hypot(bx - ax, by - ay), 1e-9)
        ux, uy, n = (bx - ax) / length, (by - ay) / length, max(int(length / spacing), 1)
        gap = np.full(n, reach)
        first = np.searchsorted(points[:, 1], min(ay, by) - reach)
        last = np.searchsorted(points[:, 1], max(ay, by) + reach)
        for i in range(first, last):
            x, y = points[i, 0] - ax, points[i, 1] - ay
            along, inside = x * ux + y * uy, ux * y - uy * x
            if 0.0 <= along < length and -reach < inside < reach:
                row = int(along / length * n)
                gap[row] = min(gap[row], inside)
        found[w, 0], found[w, 1] = n, np.quantile(gap, _OUTERMOST)
    return found


def told_precision(
    solid: Solid, topology: RoofTopology, outline: Outline, sampling: Sampling
) -> tuple[dict[str, Any], ...]:
    """
    Return for each face of a solid how sure it is, standard deviations [m].

    Roofs have `corner_sigmas`, for each corner of each ring those along x, y and z, and `elevation_sigma`,
    that of the plane amid them. Walls have `position_sigma`, across. A given outline is taken as right: its
    walls have none, nor have corners on them along x and y.
    """
    faces = face_arrays(solid)
    starts = faces.corner_starts
    own = np.repeat(np.arange(len(solid.faces)), np.diff(starts))
    kinds = np.array(solid.semantics)
    is_roof, is_wall = (kinds == ROOF_SURFACE)[own], (kinds == WALL_SURFACE)[own]
    corners, normals = solid.vertices[faces.corners], _area_vectors(faces)
    roof_sigmas = _plane_sigmas(corners[is_roof], own[is_roof], topology.planes)
    walls = np.flatnonzero(kinds == WALL_SURFACE)
    across = normals[walls, :2] / np.maximum(np.hypot(*normals[walls, :2].T), _LEAST)[:, None]
    of_wall = np.searchsorted(walls, own[is_wall])
    lines = _lines_of(corners[is_wall, :2], of_wall, across)
    edges, middles = ring_walls(outline.rings), shapely.points(lines.mean(axis=1))
    nearest = shapely.STRtree(shapely.linestrings(edges)).nearest(middles)
    is_outer = shapely.distance(shapely.linestrings(edges[nearest]), middles) < _ON_OUTLINE
    lines[is_outer] = edges[nearest[is_outer]]
    # A line through points is less sure the farther from their middle.
    aside = ((corners[is_wall, :2] - lines.mean(axis=1)[of_wall]) ** 2).sum(axis=1)
    aside /= np.maximum(((lines[:, 1] - lines[:, 0]) ** 2).sum(axis=1), _LEAST)[of_wall]
    variances = wall_variances(lines, is_outer, sampling)
    if topology.wall_shares is not None and len(topology.wall_shares) == len(edges):
        variances[is_outer] *= topology.wall_shares[nearest[is_outer], None]
    variances[is_outer, 0] += (sampling.wall_bias or 0.0) ** 2
    of_all, of_middle = variances[of_wall].T
    upward = normals / np.maximum(normals[:, 2:], _LEAST)
    upward[walls, :2], upward[walls, 2] = across, 0.0
    sigmas = np.zeros(len(own))
    sigmas[is_roof], sigmas[is_wall] = roof_sigmas, np.sqrt(of_all + of_middle * (1.0 + _LEVER * aside))
    used = is_roof | is_wall
    conditions = Conditions(faces.corners[used], upward[own[used]], sigmas[used], is_wall[used])
    covariances = corner_covariances(conditions, len(solid.vertices), _LOOSE * sampling.spacing)
    of_corners = np.sqrt(np.einsum("kii->ki", covariances)).round(DECIMALS).astype(object)
    is_given = np.zeros(len(kinds), dtype=np.bool_)
    is_given[walls] = is_outer & (sampling.wall_bias is None)
    of_corners[faces.corners[is_given[own]], :2] = None
    every = of_corners.tolist()
    middle = np.sqrt(np.bincount(own, sigmas**2) / np.bincount(own)).round(DECIMALS).tolist()
    told: list[dict[str, Any]] = [{} for _ in solid.faces]
    for number, (face, kind) in enumerate(zip(solid.faces, solid.semantics, strict=True)):
        if kind == ROOF_SURFACE:
            told[number]["elevation_sigma"] = middle[number]
            told[number]["corner_sigmas"] = [[every[row] for row in ring] for ring in face]
        elif kind == WALL_SURFACE and not is_given[number]:
            told[number]["position_sigma"] = middle[number]
    return tuple(told)


def precision_attributes(told: Iterable[dict[str, Any]]) -> dict[str, float | None]:
    """Return the medians of the standard deviations of a roof's corners, along x or y, and along z [m]."""
    corners = [corner for one in told for ring in one.get("corner_sigmas", ()) for corner in ring]
    plan = [math.hypot(x, y) / math.sqrt(2.0) for x, y, _ in corners if x is not None]
    return {
        "corner_sigma_xy": round(float(np.median(plan)), DECIMALS) if plan else None,
        "corner_sigma_z": round(float(np.median([z for _, _, z in corners])), DECIMALS) if corners else None,
    }


def _area_vectors(faces: FaceArrays) -> FloatArray:
    """Return the normals of faces, as long as twice their areas, shape (n_faces, 3) [m²]."""
    corners = faces.vertices[faces.corners] - faces.vertices[0]
    following = np.arange(1, len(corners) + 1)
    following[faces.ring_starts[1:] - 1] = faces.ring_starts[:-1]
    return np.asarray(np.add.reduceat(cross(corners, corners[following]), faces.corner_starts[:-1]))


def _plane_sigmas(corners: FloatArray, face: IntArray, planes: Sequence[RoofPlane]) -> FloatArray:
    """Return the standard deviations of roofs' planes along z at the corners of their faces [m]."""
    if not len(planes) or not len(corners):
        return np.full(len(corners), NO_PLANE)
    equations = np.array([plane.equation for plane in planes])
    first = np.flatnonzero(np.diff(face, prepend=-1))
    away = np.abs(corners[:, :2] @ equations[:, :2].T + equations[:, 2] - corners[:, 2:])
    away = np.maximum.reduceat(away, first)
    n = np.diff(first, append=len(face))
    best = away.argmin(axis=1).repeat(n)
    place = np.ones((len(corners), 3))
    place[:, :2] = corners[:, :2] - np.array([plane.centroid[:2] for plane in planes])[best]
    covariances = np.array([plane.covariance for plane in planes])[best]
    sigma = np.sqrt(np.einsum("ni,nij,nj->n", place, covariances, place))
    return np.where(away.min(axis=1).repeat(n) < _SAME_PLANE, sigma, NO_PLANE)


def _lines_of(corners: FloatArray, wall: IntArray, across: FloatArray) -> FloatArray:
    """Return walls seen from above with the building to their left, shape (n_walls, 2, 2)."""
    if not len(wall):
        return np.empty((0, 2, 2))
    first = np.flatnonzero(np.diff(wall, prepend=-1))
    along = np.column_stack([-across[:, 1], across[:, 0]])
    away = ((corners - corners[first][wall]) * along[wall]).sum(axis=1)
    ends = np.column_stack([np.minimum.reduceat(away, first), np.maximum.reduceat(away, first)])
    return np.asarray(corners[first][:, None, :] + ends[:, :, None] * along[:, None, :])
