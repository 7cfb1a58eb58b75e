"""Models of live buildings between two sendings of their tiles: points are added to sums."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.ids import rows_by_building, tile_of
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.solids.output_grid import on_grid
from lidar_buildings.core.solids.shell import ROOF_SURFACE, WALL_SURFACE, area_vector, face_plane
from lidar_buildings.core.solids.triangulation import face_arrays
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model.model import LOD22
from lidar_buildings.core.stages.building_model.precision import (
    DECIMALS,
    NO_PLANE,
    TURN,
    Conditions,
    corner_covariances,
    precision_attributes,
)
from lidar_buildings.core.surfaces.plane_adjustment import CORNER, POINT, Adjustment, Condition
from lidar_buildings.core.surfaces.plane_adjustment import moved as moved_origin
from lidar_buildings.core.surfaces.roof_planes import PlaneSums, free_planes
from lidar_buildings.pipeline.tile_models import TileModel

#: Attribute of a model that was solved again since its tile was sent; none in files has it.
PROVISIONAL = "provisional"
#: Points so near to a plane are on it: so many times the roof's roughness, at least this [m].
_ROUGH, _LEAST_NEAR = 3.0, 0.1
#: Faces of one plane, and walls of one line, are so near to it [m]; these turn by less (cosine).
_SAME, _PARALLEL = 0.02, 0.9999
#: A plane of fewer points stays as it was.
_FEWEST = 8
#: Planes meet at a corner to this [m]; more of them than these meet at a point by a condition alone.
_MEET, _AT_A_POINT = 0.01, 3
#: A quarter of the rows of points end this much before a wall, as a share of their mean gap, which has an
#: exponential distribution (−ln ¾); the standard deviation of that, times the root of their number.
_QUARTER, _GAP, _GAP_SIGMA = 0.25, 0.2877, 0.5774
#: What all of a wall is off by, however many of its rows are seen [spacings].
_WALL_BIAS = 0.055
#: Points so near to a wall tell of it [spacings], unless it lies elsewhere by more standard deviations.
_REACH, _SIGNIFICANT = 2.0, 3.0
#: Keeps what nothing fixes where it was [1/m²].
_LOOSE = 1e-3
#: Least share of new points for which a model is solved again.
_NEW = 0.05
#: Roofs that are remembered: those of the tiles that came last (20 kB each).
_MOST = 10_000
_log = logging.getLogger(__name__)


class LiveRoof:
    """
    A roof whose topology is known, as sums to which points can be added.

    Planes have the sums of their points, walls the outermost point of each row of points that ends at them:
    both depend neither on the order of points nor on their portions. `built` is the model that topology comes
    from, `stamp` that of its tile [ns]. `spacing` is that of its points, `bias` by how much its walls are
    inside the roof's edge [m].
    """

    def __init__(self, built: TileModel, spacing: float, bias: float = 0.0, stamp: int = 0) -> None:
        self.stamp, self.built, self._spacing, self._bias = stamp, built, spacing, bias
        self.n_points = self.n_first = 0
        solid, self._told = built.model.solids[LOD22], built.model.of_faces[LOD22]
        self._solid, faces, kinds = solid, face_arrays(solid), np.array(solid.semantics)
        self._corners = faces.corners
        rings = [solid.face_rings(face) for face in solid.faces]
        roofs, walls = (np.flatnonzero(kinds == kind) for kind in (ROOF_SURFACE, WALL_SURFACE))
        flat = [[ring[:, :2] for ring in rings[k]] for k in roofs]
        self._plans = np.array([shapely.Polygon(shell, holes) for shell, *holes in flat])
        self._tree = shapely.STRtree(self._plans)
        self._planes, self._plane_of_roof = _planes_of([rings[k] for k in roofs])
        self._across, self._lines = _walls_of([rings[k] for k in walls])
        self._line_of_wall = _in_lines(self._across, self._lines)
        self._sigma = np.array([self._told[k].get("position_sigma", 0.0) for k in walls])
        foot = solid.vertices[:, 2].min() + _SAME
        is_outer = np.array([rings[k][0][:, 2].min() < foot for k in walls], dtype=np.bool_)
        self._is_outer = is_outer & (self._sigma > 0.0)
        #: Of each corner of each face the roof's plane and the wall, −1 for none.
        self._plane, self._wall = np.full((2, len(kinds)), -1)
        self._plane[roofs], self._wall[walls] = self._plane_of_roof, np.arange(len(walls))
        self._face = np.repeat(np.arange(len(kinds)), np.diff(faces.corner_starts))
        self._plane, self._wall = self._plane[self._face], self._wall[self._face]
        corners = np.concatenate([rings[k][0] for k in roofs])
        self.low, self.high = corners.min(axis=0) - spacing, corners.max(axis=0) + spacing
        self._sums = PlaneSums(0.5 * (self.low + self.high), len(self._planes))
        self._length = np.hypot(*(self._lines[:, 1] - self._lines[:, 0]).T)
        self._n_rows = np.maximum(self._length / spacing, 1.0).astype(np.int64)
        self._first_row = np.cumsum(self._n_rows) - self._n_rows
        self._gaps = np.full(self._n_rows.sum(), _REACH * spacing)
        self._near = max(_ROUGH * (built.attributes.get("plane_sigma") or 0.0), _LEAST_NEAR)

    def add(self, points: FloatArray) -> int:
        """Add those of some points, shape (n, 3) [m], that are on the roof; return how many."""
        points = points[((points >= self.low) & (points <= self.high)).all(axis=1)]
        row, face = self._tree.query(shapely.points(points[:, :2]), "dwithin", self._spacing)
        a, b, c = self._planes[self._plane_of_roof[face]].T
        is_on = np.abs(a * points[row, 0] + b * points[row, 1] + c - points[row, 2]) < self._near
        row, face = row[is_on], face[is_on]
        self._add_to_walls(points[np.unique(row), :2])
        is_inside = shapely.intersects_xy(self._plans[face], *points[row, :2].T)
        plane_id = np.zeros(len(points), dtype=np.uint16)
        plane_id[row[is_inside]] = self._plane_of_roof[face[is_inside]] + 1
        self._sums.add(points, plane_id)
        n = int(np.count_nonzero(plane_id))
        self.n_points += n
        return n

    def _add_to_walls(self, xy: FloatArray) -> None:
        """Let rows of points across walls end with the outermost ones."""
        away = xy[:, None] - self._lines[:, 0]
        inside = -(away * self._across).sum(axis=2)
        along = away[:, :, 1] * self._across[:, 0] - away[:, :, 0] * self._across[:, 1]
        is_near = (along >= 0.0) & (along < self._length) & (np.abs(inside) < _REACH * self._spacing)
        wall = np.nonzero(is_near)[1]
        row = (along[is_near] / self._length[wall] * self._n_rows[wall]).astype(np.int64)
        row = self._first_row[wall] + np.minimum(row, self._n_rows[wall] - 1)
        np.minimum.at(self._gaps, row, inside[is_near])

    def solved(self) -> TileModel:
        """
        Return the model as all points tell: planes, walls, and corners where those meet that they lie on.

        Other levels of detail stay as they were, and all of it if faces were not flat otherwise.
        """
        vertices = self._solid.vertices
        moves, variances = self._solved_walls()
        roof, wall = np.flatnonzero(self._plane >= 0), np.flatnonzero(self._wall >= 0)
        level = np.zeros((len(wall), 3))
        level[:, :2], own = self._across[self._wall[wall]], self._wall[wall]
        walls = Conditions(self._corners[wall], level, np.sqrt(variances[own]), own >= 0)
        is_fixed, shift = _fixed_by_walls(walls, moves[own], len(vertices))
        equations, covariances, centroids = self._solved_planes(vertices[:, :2] + shift, is_fixed)
        plane, at = self._plane[roof], vertices[self._corners[roof]]
        place = np.ones((len(at), 3))
        place[:, :2] = at[:, :2] - centroids[plane]
        place[~self._planes[plane, :2].any(axis=1), :2] = 0.0  # level planes have no slope to be unsure of
        variance = np.einsum("ni,nij,nj->n", place, covariances[plane], place)
        a, b, c = equations[plane].T
        upward = np.column_stack([-a, -b, np.ones(len(roof))])
        roofs = Conditions(self._corners[roof], upward, np.sqrt(variance), plane < 0)
        conditions = Conditions(*(np.concatenate(both) for both in zip(roofs, walls, strict=True)))
        off = np.concatenate([a * at[:, 0] + b * at[:, 1] + c - at[:, 2], moves[own]])
        moved = _moved(conditions, off, is_fixed, shift)
        solid = replace(self._solid, vertices=on_grid(vertices + moved))
        new: dict[str, Any] = {PROVISIONAL: True, "n_points": self.n_points}
        if check_solid(solid):
            return replace(self.built, attributes=self.built.attributes | new)
        covariance = corner_covariances(conditions, len(vertices), self._spacing)
        sigmas = np.sqrt(np.einsum("kii->ki", covariance)).round(DECIMALS).tolist()
        faces = self._face[np.concatenate([roof, wall])]
        square = np.bincount(faces, conditions.sigma**2, len(solid.faces))
        across = np.sqrt(square / np.maximum(np.bincount(faces, minlength=len(solid.faces)), 1))
        columns = self._told, solid.faces, across.round(DECIMALS).tolist()
        told = tuple(_retold(*each, sigmas) for each in zip(*columns, strict=True))
        old = self.built.model
        model = replace(old, solids={**old.solids, LOD22: solid}, of_faces={**old.of_faces, LOD22: told})
        new |= precision_attributes(told)
        return replace(self.built, model=model, attributes=self.built.attributes | new)

    def _solved_planes(
        self, xy: FloatArray, is_fixed: BoolArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """
        Return a, b, c of the planes, covariances of these about their points' centroids, and those.

        The planes meet at corners that walls fix in plan, at these places [m], and where four or more of them
        did, as far as their points do not refuse it (`Adjustment.under`).
        """
        free = free_planes(self._sums.moments)
        centre, found, covariances = free.moments.centre, free.coefficients.copy(), free.covariance.copy()
        is_level = ~self._planes[:, :2].any(axis=1)
        found[is_level] = free.mean[is_level] * (0.0, 0.0, 1.0)
        covariances[is_level, :2], covariances[is_level, :, :2] = 0.0, 0.0
        is_kept = ~free.roof | (free.counts < _FEWEST)
        found[is_kept] = self._planes[is_kept]
        found[is_kept, 2] += found[is_kept, :2] @ centre[:2] - centre[2]
        covariances[is_kept] = np.diag([0.0, 0.0, NO_PLANE**2])
        about = moved_origin(covariances, -free.mean)
        conditions = list(self._conditions(xy - centre[:2], is_fixed))
        joint = Adjustment(free, np.full(len(found), -1), found, about).under(conditions)
        found = joint.coefficients.copy()
        found[:, 2] += centre[2] - found[:, :2] @ centre[:2]
        return found, moved_origin(joint.covariances, free.mean), free.mean[:, :2] + centre[:2]

    def _conditions(self, xy: FloatArray, is_fixed: BoolArray) -> Iterator[Condition]:
        """Yield that planes meet where corners lie about the centre [m]."""
        pairs = np.unique(np.column_stack([self._corners, self._plane])[self._plane >= 0], axis=0)
        for vertex, planes in groupby(pairs.tolist(), lambda one: one[0]):
            own = tuple(plane + 1 for _, plane in planes)
            n = len(own)
            if n > 1 and is_fixed[vertex]:
                factors = np.zeros((n - 1, n, 1))
                factors[:, 0], factors[np.arange(n - 1), np.arange(1, n)] = 1.0, -1.0
                yield Condition(CORNER, own, _MEET, factors * np.append(xy[vertex], 1.0))
            elif n > _AT_A_POINT:
                yield Condition(POINT, own, _MEET)

    def _solved_walls(self) -> tuple[FloatArray, FloatArray]:
        """
        Return by how much walls move outwards [m], and their variances [m²].

        Along a wall points are scattered evenly: the gaps between it and the outermost ones of rows as wide
        as a spacing have an exponential distribution, whose mean the density tells. Its lower quartile does
        not mind rows that end elsewhere. The mean of that and of where the wall was is taken by weights.
        """
        moves, variances = np.zeros(len(self._lines)), self._sigma**2
        if self.n_points <= self.n_first:
            return moves, variances
        mean_gap = float(shapely.area(self._plans).sum()) / (self.n_points * self._spacing)
        bias = self._bias * np.sqrt(self.n_first / self.n_points)
        row_line = np.where(self._is_outer, self._line_of_wall, -1).repeat(self._n_rows)
        for line in np.unique(self._line_of_wall[self._is_outer]):
            gaps, own = self._gaps[row_line == line], self._line_of_wall == line
            before = (self._sigma[own & self._is_outer] ** 2).min() - self._bias**2
            now = (_GAP_SIGMA * mean_gap) ** 2 / len(gaps)
            move = _GAP * mean_gap - float(np.quantile(gaps, _QUARTER)) - bias
            if before > 0.0 and move**2 < _SIGNIFICANT**2 * (before + now):
                moves[own] = move * before / (before + now)
                chance = before * now / (before + now)
                variances[own] = bias**2 + (_WALL_BIAS * self._spacing) ** 2 + chance
        return moves, variances


def _planes_of(roofs: Sequence[tuple[FloatArray, ...]]) -> tuple[FloatArray, IntArray]:
    """Return a, b, c of the planes of faces, each once, and which of them each face lies in."""
    planes: list[tuple[float, float, float]] = []
    plane_of_face = []
    for rings in roofs:
        x, y, z = np.concatenate(rings).T
        near = (k for k, (a, b, c) in enumerate(planes) if np.abs(a * x + b * y + c - z).max() < _SAME)
        number = next(near, len(planes))
        if number == len(planes):
            planes.append(face_plane(rings) or (0.0, 0.0, float(z.mean())))
        plane_of_face.append(number)
    return np.array(planes), np.array(plane_of_face, dtype=np.int64)


def _walls_of(walls: Sequence[tuple[FloatArray, ...]]) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors that point out of walls in plan, (n, 2), and where these stand, (n, 2, 2) [m]."""
    across = np.array([area_vector(rings)[:2] for rings in walls]).reshape(-1, 2)
    across /= np.maximum(np.hypot(*across.T), 1e-9)[:, None]
    lines = np.empty((len(walls), 2, 2))
    for line, (x, y), rings in zip(lines, across, walls, strict=True):
        along = (rings[0][:, :2] - rings[0][0, :2]) @ (-y, x)
        line[:] = rings[0][0, :2] + np.outer([along.min(), along.max()], (-y, x))
    return across, lines


def _in_lines(across: FloatArray, lines: FloatArray) -> IntArray:
    """Return for each wall the first one that stands in one line with it."""
    apart = (lines.mean(axis=1)[:, None] - lines.mean(axis=1)) * across
    is_same = (across @ across.T > _PARALLEL) & (np.abs(apart.sum(axis=2)) < _SAME)
    return is_same.argmax(axis=1)


def _solved(conditions: Conditions, off: FloatArray, n_vertices: int, n_axes: int) -> FloatArray:
    """Return the least-squares shifts of corners to planes that are off by so much [m]."""
    vertex, normal, weight = conditions.vertex, conditions.normal[:, :n_axes], 1.0 / conditions.sigma**2
    matrix = np.tile(_LOOSE * np.eye(n_axes), (n_vertices, 1, 1))
    right = np.zeros((n_vertices, n_axes, 1))
    np.add.at(matrix, vertex, weight[:, None, None] * normal[:, :, None] * normal[:, None])
    np.add.at(right, vertex, (weight * off)[:, None, None] * normal[:, :, None])
    return np.asarray(np.linalg.solve(matrix, right)[:, :, 0])


def _fixed_by_walls(walls: Conditions, off: FloatArray, n_vertices: int) -> tuple[BoolArray, FloatArray]:
    """Return which corners walls that turn fix in plan, and by how much these move to them [m]."""
    turns = np.zeros((n_vertices, 2, 2))
    np.add.at(turns, walls.vertex, walls.normal[:, :2, None] * walls.normal[:, None, :2])
    is_fixed = np.asarray(np.linalg.det(turns) > TURN)
    return is_fixed, _solved(walls, off, n_vertices, 2) * is_fixed[:, None]


def _moved(conditions: Conditions, off: FloatArray, is_fixed: BoolArray, shift: FloatArray) -> FloatArray:
    """
    Return by how much corners move to where planes meet that are off by so much now [m], (n_vertices, 3).

    One that is fixed in plan gets the mean height of its roof planes there: so it was built. Others are their
    least-squares intersection.
    """
    n_vertices, is_roof = len(is_fixed), ~conditions.is_wall
    moved = _solved(conditions, off, n_vertices, 3)
    moved[is_fixed, :2] = shift[is_fixed]
    of_roof = conditions.vertex[is_roof]
    rises = off[is_roof] - (conditions.normal[is_roof, :2] * moved[of_roof, :2]).sum(axis=1)
    n_roofs = np.bincount(of_roof, minlength=n_vertices)
    mean = np.bincount(of_roof, rises, n_vertices) / np.maximum(n_roofs, 1)
    moved[is_fixed, 2] = mean[is_fixed]
    return moved


def _retold(
    told: dict[str, Any], face: Sequence[Sequence[int]], across: float, sigmas: list[list[float]]
) -> dict[str, Any]:
    """Return what is told of a face with new standard deviations where any was told, [m]."""
    new = dict.fromkeys(told.keys() & {"elevation_sigma", "position_sigma"}, across)
    if "corner_sigmas" not in told:
        return told | new
    of_rings = [
        [[None if was is None else now for was, now in zip(one, sigmas[row], strict=True)]
         for row, one in zip(ring, own, strict=True)]
        for ring, own in zip(face, told["corner_sigmas"], strict=True)
    ]  # fmt: skip
    return {**told, **new, "corner_sigmas": of_rings}


class LiveModels:
    """The roofs of tiles that may come again, and points that were measured since they came."""

    def __init__(self) -> None:
        self._roofs: dict[int, list[LiveRoof]] = {}
        self._extents: dict[int, tuple[FloatArray, FloatArray]] = {}  # of tiles [m]
        #: Roofs that have new points, and how many: those of the last points; all since they were told.
        self._touched: set[LiveRoof] = set()
        self._new: dict[LiveRoof, int] = {}

    def replace(self, stamp: int, roofs: list[LiveRoof]) -> None:
        """Take the roofs of a tile's revision in place of those of an earlier one."""
        self._forget(tile_of(stamp))
        self._roofs[tile_of(stamp)] = roofs
        while sum(map(len, self._roofs.values())) > _MOST and len(self._roofs) > 1:
            self._forget(next(iter(self._roofs)))
        low, high = np.array([[one.low, one.high] for one in roofs]).reshape(-1, 2, 3).transpose(1, 0, 2)
        self._extents[tile_of(stamp)] = low.min(axis=0, initial=np.inf), high.max(axis=0, initial=-np.inf)

    def _forget(self, tile: int) -> None:
        self._extents.pop(tile, None)
        for roof in self._roofs.pop(tile, ()):
            self._new.pop(roof, None)

    def add(self, points: FloatArray) -> None:
        """Add points, shape (n, 3) [m], to the roofs that they are on."""
        if not len(points):
            return
        points = points[np.argsort(points[:, 0])]
        extent = points.min(axis=0), points.max(axis=0)
        for tile, roofs in self._roofs.items():
            for roof in roofs if _meet(self._extents[tile], extent) else ():
                rows = slice(*np.searchsorted(points[:, 0], (roof.low[0], roof.high[0])))
                if _meet((roof.low, roof.high), extent) and (n := roof.add(points[rows])):
                    self._new[roof] = self._new.get(roof, 0) + n
                    self._touched.add(roof)

    def solved(self) -> Iterator[tuple[int, TileModel]]:
        """Yield anew stamps and models of roofs with enough new points, none of them since the last call."""
        for roof in [one for one in self._new if one not in self._touched]:
            if self._new[roof] >= _NEW * roof.n_points:
                del self._new[roof]
                try:
                    solved = roof.solved()
                except Exception:
                    _log.exception("building %d: its model stays as it was", roof.built.building_id)
                else:
                    yield roof.stamp, solved
        self._touched.clear()


def _meet(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> bool:
    return bool((one[0] <= other[1]).all() and (one[1] >= other[0]).all())


def live_roofs(
    tile: PointTile, outlines: Sequence[BuildingOutline], models: Sequence[TileModel]
) -> list[LiveRoof]:
    """Return the roofs of a tile's models of LoD2.2 with its points, as `build_models` has them."""
    bias = {one.building_id: one.quality.bias if one.quality else 0.0 for one in outlines}
    rows = {} if tile.building_id is None else dict(rows_by_building(tile.building_id))
    found = []
    for one in models:
        if not one.model.solids or max(one.model.solids) != LOD22 or one.building_id not in rows:
            continue
        try:
            roof = LiveRoof(one, tile.point_spacing or 1.0, bias.get(one.building_id, 0.0), tile.stamp)
            roof.n_first = roof.add(tile.points[rows[one.building_id]])
        except Exception:
            _log.exception("building %d: no later points are added to it", one.building_id)
        else:
            found.append(roof)
    return found
