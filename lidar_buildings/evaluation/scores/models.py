"""Building models against reference models and points of roofs; wireframes of visible corners and edges."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, Face, Solid
from lidar_buildings.evaluation.scores.cells import Figures, mean, named, percentile, ratio, root_mean_square
from lidar_buildings.evaluation.scores.outlines import (
    MIN_INSIDE,
    MIN_IOU,
    cut_to,
    limits_of,
    match_corners,
    match_outlines,
    spots_along,
    valid_polygons,
    within,
)

#: A building: one solid, or several parts.
Solids = Sequence[Solid]
#: A roof face so steep that it hides this much less than its area in plan is a wall [m/m].
_LEAST_UPRIGHT = 1e-3
#: Parts of footprints nearer than this are one [m]: the grid on which models are written.
_GRID = 1e-3


def roof_elevations(solids: Iterable[Solid], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the elevation of the highest roof [m] at positions of shape (n, 2 or more), NaN for none."""
    polygons, origins, normals = [], [], []
    for solid in solids:
        for face in faces_of(solid, ROOF_SURFACE):
            rings = solid.face_rings(face)
            normal = unit_normal(rings[0])
            if abs(normal[2]) >= _LEAST_UPRIGHT:
                polygons.append(_plan(rings))
                origins.append(rings[0].mean(axis=0))
                normals.append(normal)
    row, face = shapely.STRtree(polygons).query(shapely.points(xy[:, :2]), predicate="intersects")
    origin, normal = np.reshape(origins, (-1, 3))[face], np.reshape(normals, (-1, 3))[face]
    rise = ((origin[:, :2] - xy[row, :2]) * normal[:, :2]).sum(axis=1) / normal[:, 2]
    elevation = np.full(len(xy), np.nan)
    np.fmax.at(elevation, row, origin[:, 2] + rise)
    return elevation


def footprints(buildings: Sequence[Solids]) -> NDArray[Any]:
    """Return what each building covers in plan: its ground faces, or its roof where it has none."""

    def footprint(parts: Solids) -> shapely.Geometry:
        for kind in (GROUND_SURFACE, ROOF_SURFACE):
            faces = [_plan(solid.face_rings(face)) for solid in parts for face in faces_of(solid, kind)]
            if faces:
                return shapely.union_all(shapely.make_valid(np.array(faces, dtype=object)), grid_size=_GRID)
        return shapely.Polygon()

    return np.array([footprint(parts) for parts in buildings], dtype=object)


def faces_of(solid: Solid, kind: str) -> list[Face]:
    """Return a solid's faces of one kind: GroundSurface, RoofSurface or WallSurface."""
    return [face for face, word in zip(solid.faces, solid.semantics, strict=True) if word == kind]


def unit_normal(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normal of a ring (Newell's sum), zeros if it has no area."""
    edges = ring - ring[0]
    normal: NDArray[np.float64] = np.cross(edges[1:-1], edges[2:]).sum(axis=0)
    length = np.linalg.norm(normal)
    return normal / length if length > 0 else np.zeros(3)


def _plan(rings: Sequence[NDArray[np.float64]]) -> shapely.Polygon:
    return shapely.Polygon(rings[0][:, :2], [ring[:, :2] for ring in rings[1:]])


#: Faces that meet at a smaller angle are one surface, and edges that turn by less are one line [deg].
MIN_FOLD_DEG = 1.0
#: A ridge is level but for so much [deg]; wide margin: a hip of a 30° roof rises by 22°.
MAX_RIDGE_SLOPE_DEG = 5.0
#: Corners closer than this are one [m]: the grid on which models are written.
SAME_CORNER = 1e-3

#: Two corners by their numbers, the smaller first.
Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Wireframe:
    """Corners and the straight edges between them."""

    corners: NDArray[np.float64]  #: where edges end or turn [m], shape (n_corners, 3)
    edges: NDArray[np.int64]  #: rows of the corners, shape (n_edges, 2)
    #: Whether the roof falls to both sides of an edge that is level, shape (n_edges,).
    is_ridge: NDArray[np.bool_]

    @property
    def segments(self) -> NDArray[np.float64]:
        """The ends of each edge, shape (n_edges, 2, 3) [m]."""
        return self.corners[self.edges]


class _Side(NamedTuple):
    """What lies along one directed edge: its face's kind and normal, and its direction."""

    is_roof: bool
    normal: NDArray[np.float64]
    along: NDArray[np.float64]


def roof_wireframe(solids: Iterable[Solid]) -> Wireframe:
    """
    Return the ridges, hips, valleys, eaves and step edges of roofs, each line of them once.

    An edge is one of a roof face behind which the surface folds by a degree or more; what only parts one
    plane into several faces is none. Consecutive edges on a straight line are one. Solids that share an edge,
    as touching houses do, have it in common.
    """
    rows: dict[tuple[int, ...], int] = {}
    edges: dict[Pair, bool] = {}
    for solid in solids:
        places = [tuple(place) for place in np.rint(solid.vertices / SAME_CORNER).astype(np.int64).tolist()]
        for pair_of_solid, is_ridge in _folds(solid).items():
            ends = sorted(rows.setdefault(places[k], len(rows)) for k in pair_of_solid)
            if ends[0] != ends[1]:
                pair = ends[0], ends[1]
                edges[pair] = edges.get(pair, True) and is_ridge
    corners = np.array(list(rows), dtype=np.float64).reshape(-1, 3) * SAME_CORNER
    edges = _straightened(corners, edges)
    used, ends_of = np.unique(np.array(list(edges), dtype=np.int64).reshape(-1, 2), return_inverse=True)
    ridges = np.array(list(edges.values()), dtype=bool)
    return Wireframe(corners[used], ends_of.reshape(-1, 2).astype(np.int64), ridges)


def n_corners(solid: Solid) -> int:
    """Count the corners of a whole solid: vertices at which three surfaces or more meet."""
    frame = _straightened(solid.vertices, dict.fromkeys(_folds(solid, of_roofs=False), False))
    return len({end for pair in frame for end in pair})


def _folds(solid: Solid, *, of_roofs: bool = True) -> dict[Pair, bool]:
    """Return the edges at which a solid's surface folds, and whether they are ridges."""
    sides: dict[Pair, list[_Side]] = defaultdict(list)
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        normal = unit_normal(solid.vertices[list(face[0])])
        for ring in face:
            for i, j in zip(ring, ring[1:] + ring[:1], strict=True):
                along = solid.vertices[j] - solid.vertices[i]
                sides[min(i, j), max(i, j)].append(_Side(kind == ROOF_SURFACE, normal, along))
    return {
        pair: _is_ridge(around)
        for pair, around in sides.items()
        if (not of_roofs or any(side.is_roof for side in around)) and _is_fold(around)
    }


def _is_fold(sides: Sequence[_Side]) -> bool:
    cosine = min((float(sides[0].normal @ side.normal) for side in sides[1:]), default=-1.0)
    return cosine < math.cos(math.radians(MIN_FOLD_DEG))


def _is_ridge(sides: Sequence[_Side]) -> bool:
    if len(sides) != 2 or not all(side.is_roof for side in sides):
        return False
    along = sides[0].along
    if abs(along[2]) > math.tan(math.radians(MAX_RIDGE_SLOPE_DEG)) * math.hypot(along[0], along[1]):
        return False
    # A face lies to the left of its edge; its upward normal leans to where it falls.
    return all(float(side.normal[:2] @ (-side.along[1], side.along[0])) > 0 for side in sides)


def _straightened(corners: NDArray[np.float64], edges: dict[Pair, bool]) -> dict[Pair, bool]:
    """Join edges that continue one another where no other edge ends."""
    kept = dict(edges)
    around: dict[int, set[int]] = defaultdict(set)
    for i, j in edges:
        around[i].add(j)
        around[j].add(i)
    for corner in sorted(around):
        if len(around[corner]) != 2:
            continue
        one, other = sorted(around[corner])
        if other in around[one] or not _is_straight(corners[[one, corner, other]]):
            continue
        flags = [kept.pop((min(corner, end), max(corner, end))) for end in (one, other)]
        kept[one, other] = all(flags)
        for end, next_end in ((one, other), (other, one)):
            around[end] = around[end] - {corner} | {next_end}
        around[corner] = set()
    return kept


def _is_straight(ends: NDArray[np.float64]) -> bool:
    before, after = ends[1] - ends[0], ends[2] - ends[1]
    lengths = float(np.linalg.norm(before) * np.linalg.norm(after))
    return float(before @ after) > math.cos(math.radians(MIN_FOLD_DEG)) * lengths


#: Lines whose directions differ by more are not the same [deg].
MAX_TURN_DEG = 15.0
#: Edges are looked at this often along their length [m]: finer than any tolerance.
_STEP = 0.25
#: So many near spots of the other side are asked for their direction.
_N_NEAR = 12


def score_wireframes(result: Wireframe, reference: Wireframe, tolerance: float) -> Figures:
    """Match corners, and edges by their ends, as Building3D does (Wang, Huang & Yang 2023) [m]."""
    mine, theirs, distance = match_corners(result.corners, reference.corners, tolerance)
    n_mine, n_theirs = len(result.corners), len(reference.corners)
    # An edge is found if the partners of its ends are joined, too.
    partner = np.full(n_mine, -1, dtype=np.int64)
    partner[mine] = theirs
    wanted = {(min(i, j), max(i, j)) for i, j in reference.edges.tolist()}
    n_edges = sum((min(i, j), max(i, j)) in wanted for i, j in partner[result.edges].tolist())
    return {
        "n_corners_result": n_mine,
        "n_corners_reference": n_theirs,
        "n_corners_matched": len(mine),
        "corner_precision": ratio(len(mine), n_mine),
        "corner_recall": ratio(len(mine), n_theirs),
        "corner_f1": ratio(2 * len(mine), n_mine + n_theirs),
        "corner_offset": mean(distance),
        "n_edges_result": len(result.edges),
        "n_edges_reference": len(reference.edges),
        "n_edges_matched": n_edges,
        "edge_f1": ratio(2 * n_edges, len(result.edges) + len(reference.edges)),
        "edge_length_precision": _share_followed(result.segments, reference.segments, tolerance),
        "edge_length_recall": _share_followed(reference.segments, result.segments, tolerance),
    }


def _share_followed(edges: NDArray[np.float64], others: NDArray[np.float64], tolerance: float) -> float:
    """Return the share of the edges' length within the tolerance of another edge of about their direction."""
    spots, directions, weights = _spots(edges)
    if not len(spots):
        return math.nan
    other_spots, other_directions, _ = _spots(others)
    if not len(other_spots):
        return 0.0
    reach = math.hypot(tolerance, _STEP / 2)
    near = cKDTree(other_spots).query(spots, k=_N_NEAR, distance_upper_bound=reach)[1]
    is_there = near < len(other_spots)
    beside = other_directions[np.where(is_there, near, 0)]
    cosine = np.abs(np.einsum("ikj,ij->ik", beside, directions))
    followed = (is_there & (cosine > math.cos(math.radians(MAX_TURN_DEG)))).any(axis=1)
    return ratio(float(weights[followed].sum()), float(weights.sum()))


def _spots(
    edges: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    row, spots = spots_along(edges, _STEP)
    vectors = edges[:, 1] - edges[:, 0]
    lengths = np.linalg.norm(vectors, axis=1)
    return spots, (vectors / lengths[:, None])[row], (lengths / np.bincount(row))[row]


def score_ridges(result: Wireframe, reference: Wireframe, tolerance: float) -> Figures:
    """Compare the elevation of each ridge with that of the nearest ridge of the result, in plan."""
    ridges = reference.segments[reference.is_ridge]
    errors = ridge_errors(result.segments[result.is_ridge], ridges, tolerance)
    found = errors[np.isfinite(errors)]
    return {
        "n_reference": len(ridges),
        "recall": ratio(len(found), len(ridges)),
        "rmse": root_mean_square(found),
        "largest": percentile(np.abs(found), 100),
    }


def ridge_errors(
    result: NDArray[np.float64], reference: NDArray[np.float64], tolerance: float
) -> NDArray[np.float64]:
    """Return how much too high the result's ridge is at the middle of each of the reference's, or NaN [m]."""
    errors = np.full(len(reference), np.nan)
    if not len(result):
        return errors
    vectors = result[:, 1] - result[:, 0]
    squared = (vectors[:, :2] ** 2).sum(axis=1)
    for row, (start, end) in enumerate(reference):
        middle, along = (start + end) / 2, end[:2] - start[:2]
        share = np.clip(((middle - result[:, 0])[:, :2] * vectors[:, :2]).sum(axis=1) / squared, 0.0, 1.0)
        foot = result[:, 0] + share[:, None] * vectors
        distance = np.hypot(*(foot - middle)[:, :2].T)
        cosine = np.abs(vectors[:, :2] @ along) / np.sqrt(squared * (along @ along))
        distance[cosine < math.cos(math.radians(MAX_TURN_DEG))] = np.inf
        nearest = int(np.argmin(distance))
        if distance[nearest] <= tolerance:
            errors[row] = foot[nearest, 2] - middle[2]
    return errors


#: Roofs are compared on a grid of this step [m], whose lines lie at multiples of it.
STEP = 0.25
#: How far a corner, an edge or a ridge may lie from the one that it stands for, unless told otherwise [m].
DEFAULT_TOLERANCE = 1.0
#: Roof type of a reference → the types of a result that mean the same, or the same of its largest part.
_ALSO: dict[str, set[str]] = {
    "hip": {"pyramid"},
    "l": {"l-shape"},
    "t": {"t-shape"},
    "l-shape": {"l"},
    "t-shape": {"t"},
    "hipped-l": {"l", "l-shape", "complex"},
    "cross-gable": {"complex", "t", "t-shape"},
    "round-tower": {"pyramid", "complex"},
    "dormer": {"gable"},
    "gable-dormer": {"gable"},
    "church": {"gable"},
    "parapet": {"flat"},
    "step": {"flat"},
}
#: Shapes that have no word of their own in results.
_COMPLEX = {
    *("barrel", "church", "courtyard", "dormer", "double-gable", "gable-dormer", "gambrel", "mansard"),
    *("parapet", "sawtooth", "step"),
}


def score_models(
    result: Sequence[Solids],
    reference: Sequence[Solids],
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    area: ArrayLike | None = None,
) -> Figures:
    """
    Compare building models with reference models, in an area if one is given.

    Roofs are compared spot by spot and wireframes line by line, however either side divides blocks into
    buildings; volumes building by building, matched by their footprints. Corners, edges and ridges may lie
    `tolerance` [m] from those that they stand for. Beside the figures, arrays give each reference building's
    partner, −1 without, and its volume ratio, NaN without.
    """
    limits = limits_of(area)
    grounds = [valid_polygons(footprints(side)) for side in (result, reference)]
    (mine, mine_inside), (theirs, theirs_inside) = (cut_to(ground, limits) for ground in grounds)
    partner, iou = match_outlines(mine, theirs)
    partner = np.where(iou >= MIN_IOU, partner, -1)
    counted = (partner >= 0) | (theirs_inside >= MIN_INSIDE)
    mine_counted = np.isin(np.arange(len(mine)), partner) | (mine_inside >= MIN_INSIDE)
    solids = [[solid for parts in side for solid in parts] for side in (result, reference)]
    my_frame, true_frame = (_inside(roof_wireframe(side), limits) for side in solids)
    volumes = [[sum(solid.volume for solid in parts) for parts in side] for side in (result, reference)]
    pairs = zip(partner.tolist(), volumes[1], strict=True)
    ratios = np.array([math.nan if k < 0 else ratio(volumes[0][k], true) for k, true in pairs])
    return {
        "n_models_result": int(np.count_nonzero(mine_counted)),
        "n_models_reference": int(np.count_nonzero(counted)),
        "n_matched": int(np.count_nonzero(partner >= 0)),
        **named("height", _heights(*solids, theirs)),
        "volume_ratio": mean(ratios[np.isfinite(ratios)]),
        **named("ridge", score_ridges(my_frame, true_frame, tolerance)),
        **named("roof", score_wireframes(my_frame, true_frame, tolerance)),
        "partner_per_reference": partner,
        "volume_ratio_per_reference": ratios,
    }


def grid_spots(polygon: shapely.Geometry, step: float) -> NDArray[np.float64]:
    """Return the crossings of a grid's lines within a polygon, shape (n, 2) [m]."""
    if polygon.is_empty:
        return np.empty((0, 2))
    west, south, east, north = polygon.bounds
    x = step * np.arange(math.ceil(west / step), math.floor(east / step) + 1)
    y = step * np.arange(math.ceil(south / step), math.floor(north / step) + 1)
    spots = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    shapely.prepare(polygon)
    return np.asarray(spots[shapely.contains_xy(polygon, spots)])


def _heights(result: list[Solid], reference: list[Solid], grounds: NDArray[Any]) -> Figures:
    spots = np.concatenate([*(grid_spots(ground, STEP) for ground in grounds), np.empty((0, 2))])
    true = roof_elevations(reference, spots)
    has_roof = np.isfinite(true)
    differences = roof_elevations(result, spots[has_roof]) - true[has_roof]
    found = differences[np.isfinite(differences)]
    return {
        "covered": ratio(len(found), len(differences)),
        "bias": mean(found),
        "rmse": root_mean_square(found),
        "percentile_95": percentile(np.abs(found), 95),
    }


def _inside(frame: Wireframe, limits: shapely.Geometry | None) -> Wireframe:
    kept = within(frame.corners, limits)
    rows = np.cumsum(kept) - 1
    edges = kept[frame.edges].all(axis=1)
    return Wireframe(frame.corners[kept], rows[frame.edges[edges]], frame.is_ridge[edges])


def same_roof_type(found: str, true: Mapping[str, Any]) -> bool:
    """Whether a word for a roof says what the reference says; one level plane of any outline is flat."""
    words = found, str(true["roof_type"])
    mine, theirs = (word.strip().lower().replace("_", "-").replace(" ", "-") for word in words)
    types = {theirs} | _ALSO.get(theirs, set())
    if theirs in _COMPLEX:
        types.add("complex")
    if true.get("n_planes") == 1 and theirs != "shed":
        types = {"flat", theirs}
    return mine in types


#: The distances within which points are counted [m].
WITHIN = (0.1, 0.2, 0.5)


def score_model_points(buildings: Sequence[Solids], points: ArrayLike) -> Figures:
    """Measure how far roof points lie above or below the roof at their place."""
    cloud = checked_points(points)
    distance = cloud[:, 2] - roof_elevations([solid for parts in buildings for solid in parts], cloud)
    distance = np.abs(distance[np.isfinite(distance)])
    return {
        "n_points": len(cloud),
        "uncovered": ratio(len(cloud) - len(distance), len(cloud)),
        "median": percentile(distance, 50),
        "rmse": root_mean_square(distance),
        **{f"within_{100 * d:.0f}_cm": ratio(int((distance <= d).sum()), len(distance)) for d in WITHIN},
    }
