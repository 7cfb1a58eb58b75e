"""Walls seen from the street beside outlines seen from above: where walls stand under the eaves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.outline import LEAST_TURN, Outline, across_walls, ring_walls
from lidar_buildings.core.solids.output_grid import GRID, on_grid, polygons_of
from lidar_buildings.core.solids.overhangs import overhung_solid
from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.shell import OUTER_CEILING_SURFACE, WALL_SURFACE, Solid
from lidar_buildings.core.stages.building_model.result import RoofFacePatch

#: A wall belongs to an edge of the outline if it runs along it, so far inside or outside [deg], [m].
_MAX_TURN, _MAX_INSIDE, _MAX_OUTSIDE = 10.0, 1.5, 0.3
#: Walls nearer to each other than this across an edge are one [m].
_ONE_WALL = 0.1
#: Length along an edge on which its wall has to be seen [m], or this share of a shorter edge.
_LEAST_SEEN, _LEAST_SHARE = 1.0, 0.3
#: Length of a wall that tells its direction [m].
_LEAST_TURNED = 2.0
#: Eaves that reach out less are none: the roof's edge is as uncertain [m].
LEAST_OVERHANG = 0.1
#: Thickness of eaves that nothing measured [m].
ASSUMED_THICKNESS = 0.2
#: Range of thicknesses that are measured, and how far apart the middle half of them may lie [m].
_THICKNESS, _MAX_SPREAD = (0.05, 0.6), 0.1
#: Points from below that measure a thickness.
_MIN_POINTS = 10


@dataclass(frozen=True, eq=False)
class EdgeWalls:
    """What was seen of the walls along each edge of an outline, its rings one after the other."""

    #: How far the wall stands inside of the edge's start and end, NaN if none was seen [m], (n_edges, 2).
    inside: FloatArray
    seen_share: FloatArray  #: share of the edge along which a wall was seen, shape (n_edges,)

    @property
    def overhang(self) -> FloatArray:
        """How far the eaves reach beyond the wall at both ends, 0 where nothing is known of any [m]."""
        return np.where(self._is_over[:, None], self.inside, 0.0)

    @property
    def correction(self) -> FloatArray:
        """How far inwards the ends of an edge move that has no eaves and whose wall was seen, else 0 [m]."""
        is_seen = ~np.isnan(self.inside[:, 0])
        return np.where((is_seen & ~self._is_over)[:, None], self.inside, 0.0)

    @property
    def _is_over(self) -> NDArray[np.bool_]:
        return np.asarray(self.inside.mean(axis=1) >= LEAST_OVERHANG)


class SeenWalls(NamedTuple):
    """What the street knows of a building."""

    walls: FloatArray  #: ends of the walls that were seen, map frame [m], shape (n_walls, 2, 2)
    points: FloatArray  #: points seen from the street around the building [m], shape (n_points, 3)


def walls_along(edges: FloatArray, walls: FloatArray) -> EdgeWalls:
    """
    Find the walls along edges.

    - `edges`, shape (n_edges, 2, 2): Start and end of each edge [m], the building to its left.
    - `walls`, shape (n_walls, 2, 2): Ends of the walls that were seen [m].
    """
    inside, share = np.full((len(edges), 2), np.nan), np.zeros(len(edges))
    for k, (start, end) in enumerate(edges):
        length = math.dist(start, end)
        if length == 0.0 or not len(walls):
            continue
        along = (end - start) / length
        across = np.array([-along[1], along[0]])
        s, d = (walls - start) @ along, (walls - start) @ across
        turn = np.degrees(np.arctan2(np.abs(np.ptp(d, axis=1)), np.abs(np.ptp(s, axis=1))))
        low, high = np.clip(s.min(axis=1), 0.0, length), np.clip(s.max(axis=1), 0.0, length)
        # where it stands halfway along what lies beside the edge
        span = s[:, 1] - s[:, 0]
        middle = np.divide(0.5 * (low + high) - s[:, 0], span, out=np.zeros(len(span)), where=span != 0.0)
        at = d[:, 0] + middle * (d[:, 1] - d[:, 0])
        fits = (turn <= _MAX_TURN) & (high > low) & (at >= -_MAX_OUTSIDE) & (at <= _MAX_INSIDE)
        if not fits.any():
            continue
        s, d, at, low, high = s[fits], d[fits], at[fits], low[fits], high[fits]
        order = np.argsort(at, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(at[order]) > _ONE_WALL) + 1)
        seen = [_covered(low[group], high[group]) for group in groups]
        best = int(np.argmax(seen))
        if seen[best] >= min(_LEAST_SEEN, _LEAST_SHARE * length):
            group = groups[best]
            weights = high[group] - low[group]
            mean = np.average(at[group], weights=weights)
            # Short walls do not tell how an edge is turned.
            slope = 0.0
            if seen[best] >= _LEAST_TURNED:
                slope = float(np.polyfit(s[group].ravel(), d[group].ravel(), 1, w=weights.repeat(2))[0])
            centre = np.average(0.5 * (low + high)[group], weights=weights)
            inside[k] = mean - slope * centre, mean + slope * (length - centre)
            share[k] = seen[best] / length
    return EdgeWalls(inside, share)


def _covered(low: FloatArray, high: FloatArray) -> float:
    """Return the length that intervals cover."""
    end, covered = -math.inf, 0.0
    for k in np.argsort(low, kind="stable").tolist():
        covered += max(0.0, high[k] - max(low[k], end))
        end = max(end, float(high[k]))
    return float(covered)


def walls_plan(outline: Outline, found: EdgeWalls) -> shapely.Geometry | None:
    """Return the plan within the walls; edges without eaves stay. None if little of the outline is left."""
    rings = _moved_rings(outline, found.overhang)
    if min(map(len, rings)) < 3:
        return None
    drawn_in = shapely.make_valid(shapely.Polygon(rings[0], rings[1:])).intersection(outline.polygon)
    parts = polygons_of(drawn_in)
    plan = shapely.union_all(parts)
    return plan if plan.area > 0.5 * outline.area else None


def corrected_pieces(
    pieces: Sequence[RoofPiece], outline: Outline, found: EdgeWalls
) -> tuple[list[RoofPiece], Outline]:
    """
    Move the edges of a roof without eaves onto the walls that were seen; planes stay as they are.

    Vertices of pieces on an edge move with it. Nothing moves if the outline would not be valid.
    """
    shift = found.correction
    moved = _moved_rings(outline, shift, keep_count=True)
    new = Outline(moved[0], tuple(moved[1:]))
    if not np.any(shift) or not new.polygon.is_valid:
        return list(pieces), outline
    corners = {tuple(place): moved_to for place, moved_to in zip(
        np.rint(np.concatenate(outline.rings) / GRID).astype(np.int64).tolist(),
        np.concatenate(moved), strict=True,
    )}  # fmt: skip
    edges = ring_walls(outline.rings)
    lines = shapely.linestrings(edges)
    across = across_walls(edges)

    def place_of(vertex: FloatArray) -> FloatArray:
        corner = corners.get(tuple(np.rint(vertex / GRID).astype(np.int64).tolist()))
        if corner is not None:
            return corner
        distance = shapely.distance(lines, shapely.Point(vertex))
        k = int(np.argmin(distance))
        if distance[k] >= 3.0 * GRID:
            return vertex
        share = math.dist(vertex, edges[k, 0]) / math.dist(*edges[k])
        return vertex + (shift[k, 0] + share * (shift[k, 1] - shift[k, 0])) * across[k]

    result = [
        RoofPiece(tuple(on_grid([place_of(vertex) for vertex in ring]) for ring in piece.rings), piece.plane)
        for piece in pieces
    ]
    return result, Outline(on_grid(new.exterior), tuple(on_grid(hole) for hole in new.holes))


def _moved_rings(outline: Outline, shift: FloatArray, keep_count: bool = False) -> list[FloatArray]:
    """Return an outline's rings with both ends of every edge moved inwards [m], cut where edges meet."""
    edges = ring_walls(outline.rings)
    moved = edges + shift[:, :, None] * across_walls(edges)[:, None]
    rings, done = [], 0
    for ring in outline.rings:
        own = moved[done : done + len(ring)]
        done += len(ring)
        corners: list[FloatArray] = []
        for (before, end), (after, beyond) in zip(np.roll(own, 1, axis=0), own, strict=True):
            u, v = end - before, beyond - after
            sine = float(u[0] * v[1] - u[1] * v[0])
            if abs(sine) > LEAST_TURN * math.hypot(*u) * math.hypot(*v):
                gap = after - before
                corners.append(before + float(gap[0] * v[1] - gap[1] * v[0]) / sine * u)
            elif keep_count or np.array_equal(end, after):
                corners.append(0.5 * (end + after))
            else:
                corners += [end, after]
        rings.append(on_grid(corners))
    return rings


def eaves_thickness(
    points: FloatArray, pieces: Sequence[RoofPiece], outline: Outline, walls: shapely.Geometry
) -> float | None:
    """
    Measure how thick eaves are, vertically, from points seen from below [m].

    - `points`, shape (n_points, 3): Seen from the street, near the building [m].

    None if too few points lie under the eaves, or they do not agree.
    """
    strip = outline.polygon.buffer(-0.5 * LEAST_OVERHANG).difference(walls.buffer(0.5 * LEAST_OVERHANG))
    if strip.is_empty or not len(points):
        return None
    own = points[shapely.contains_xy(strip, points[:, 0], points[:, 1])]
    depths = [np.empty(0)]
    for piece in pieces:
        polygon = shapely.Polygon(piece.rings[0], piece.rings[1:])
        x, y, z = own[shapely.contains_xy(polygon, own[:, 0], own[:, 1])].T
        a, b, c = piece.plane
        depths.append(a * x + b * y + c - z)
    depth = np.concatenate(depths)
    depth = depth[(depth > _THICKNESS[0]) & (depth < _THICKNESS[1])]
    if len(depth) < _MIN_POINTS:
        return None
    low, middle, high = np.percentile(depth, (25.0, 50.0, 75.0))
    return float(middle) if high - low <= _MAX_SPREAD else None


@dataclass(frozen=True, eq=False)
class OverhangingRoof:
    """A roof with eaves that overhang its walls."""

    solid: Solid
    codes: tuple[int, ...]  #: what `check_solid` says of it
    faces: list[RoofFacePatch]  #: those of the roof, with edges without eaves moved onto their walls
    thickness: float  #: of the eaves, vertically [m]
    is_measured: bool  #: whether points tell the thickness, or it is assumed


def overhanging_roof(
    faces: Sequence[RoofFacePatch], outline: Outline, ground: float, seen: SeenWalls
) -> OverhangingRoof | None:
    """
    Raise the faces of a roof above walls seen from the street, which its eaves overhang.

    Edges without eaves move onto their walls, which are seen better from there. None if no wall along the
    outline was seen.
    """
    pieces = [RoofPiece(face.rings, tuple(face.plane.tolist())) for face in faces]
    found = walls_along(ring_walls(outline.rings), seen.walls)
    if not found.seen_share.any():
        return None
    pieces, outline = corrected_pieces(pieces, outline, found)
    plan = walls_plan(outline, walls_along(ring_walls(outline.rings), seen.walls))
    if plan is None:
        return None
    thickness = eaves_thickness(seen.points, pieces, outline, plan)
    solid, codes = overhung_solid(pieces, plan, ground, thickness or ASSUMED_THICKNESS)
    moved = [replace(face, rings=piece.rings) for face, piece in zip(faces, pieces, strict=True)]
    return OverhangingRoof(solid, codes, moved, thickness or ASSUMED_THICKNESS, thickness is not None)


def told_of_faces(
    solid: Solid, walls: FloatArray, eaves: OverhangingRoof | None = None
) -> tuple[dict[str, Any], ...]:
    """
    Return for each face what walls seen from the street tell of it.

    Walls have `seen_share`, the share of their length along which a wall was seen. Soffits have `thickness`
    [m], and whether it was `measured`.
    """
    edges = []
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        if kind == WALL_SURFACE:  # seen from outside a foot runs with the building to its left
            ring = solid.vertices[list(face[0]), :2]
            other = int(np.argmax((ring != ring[0]).any(axis=1)))
            edges.append(ring[[0, other]])
    shares = iter(walls_along(np.array(edges).reshape(-1, 2, 2), walls).seen_share.tolist())
    told: list[dict[str, Any]] = []
    for kind in solid.semantics:
        if kind == WALL_SURFACE:
            told.append({"seen_share": round(next(shares), 2)})
        elif kind == OUTER_CEILING_SURFACE and eaves is not None:
            told.append({"measured": eaves.is_measured, "thickness": round(eaves.thickness, 3)})
        else:
            told.append({})
    return tuple(told)
