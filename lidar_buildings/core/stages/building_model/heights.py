"""Heights of roof faces that the points bear out, and the parts of a roof that share one height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.union_find import numbered, sets_of_pairs
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.stages.building_model.line_tiles import in_tiles, tile_of
from lidar_buildings.core.stages.building_model.roof_face import RoofFacePatch, open_rings

#: What a vertex may lie above the highest return and below the lowest [m], beside what the spacing explains.
_ABOVE, _BELOW = 0.3, 1.0
#: Edges no farther beside one another than rounding moves them run on one another; shorter ones do not [m].
_BESIDE = 0.001


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


def within_limits(faces: list[RoofFacePatch], points: FloatArray, spacing: float) -> list[RoofFacePatch]:
    """
    Cut off what reaches beyond all points.

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
    planes, exteriors = np.array([face.plane for face in faces]), [face.rings[0] for face in faces]
    sizes = np.array([len(ring) for ring in exteriors])
    z = _elevations(np.repeat(planes, sizes, axis=0), np.concatenate(exteriors))
    begin = np.cumsum(sizes) - sizes
    slack = limits.per_rise * np.hypot(planes[:, 0], planes[:, 1])
    low, high = limits.low - slack, limits.high + slack
    keeps = (low <= np.minimum.reduceat(z, begin)) & (np.maximum.reduceat(z, begin) <= high)
    return [
        piece
        for face, *levels, is_kept in zip(faces, low.tolist(), high.tolist(), keeps.tolist(), strict=True)
        for piece in ([face] if is_kept else _pieces(face, points, levels))
    ]


def _next_corners(rings: list[FloatArray]) -> IntArray:
    """Return the row of the vertex that follows each one in its ring, of all rings together."""
    ends = np.cumsum([len(ring) for ring in rings])
    follows = np.arange(1, ends[-1] + 1)
    follows[ends - 1] = np.concatenate([[0], ends[:-1]])
    return follows


def _pieces(face: RoofFacePatch, points: FloatArray, levels: list[float]) -> list[RoofFacePatch]:
    """
    Return the pieces of a face that reaches beyond two levels: the part between them, and level ones.
    """
    own = _elevations(face.plane, points[face.rows])
    whole, pieces = face.polygon, []
    bands = ((-np.inf, levels[0]), (levels[0], levels[1]), (levels[1], np.inf))
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


def _elevations(planes: FloatArray, xy: FloatArray) -> FloatArray:
    """Return the elevations of a plane, or of one each, at places."""
    return np.asarray(xy[:, 0] * planes[..., 0] + xy[:, 1] * planes[..., 1] + planes[..., 2])


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
    if len(faces) == 1:
        return np.zeros(1, dtype=np.int64)
    rings = [ring for face in faces for ring in face.rings]
    corners, owner = np.concatenate(rings), np.repeat(np.arange(len(faces)), _numbers_of_corners(faces))
    lines = np.concatenate([corners, corners[_next_corners(rings)]], axis=1)
    planes = np.array([face.plane for face in faces])
    tiles, start, items = in_tiles(lines)
    borders = np.empty((4 * len(lines) + 16, 3))
    while (n := _common_borders(lines, owner, planes, tiles, start, items, borders)) > len(borders):
        borders = np.empty((n, 3))
    pair, inverse = np.unique(borders[:n, 0], return_inverse=True)
    low = np.bincount(inverse, borders[:n, 2]) < min_step * np.bincount(inverse, borders[:n, 1])
    return numbered(sets_of_pairs(len(faces), *np.divmod(pair[low].astype(np.int64), len(faces))))


def _numbers_of_corners(faces: list[RoofFacePatch]) -> list[int]:
    return [sum(map(len, face.rings)) for face in faces]


@kernel
def _common_borders(lines, owner, planes, tiles, start, items, borders):  # type: ignore[no-untyped-def]
    """
    Write pairs of faces, the lengths of pieces of edges that they share, and these times the mean step there.

    Return how many there are.
    """
    n, n_columns, n_rows = 0, int(tiles[3]), int(tiles[4])
    for tile in range(len(start) - 1):
        for one in range(start[tile], start[tile + 1]):
            i = items[one]
            x, y = lines[i, 0], lines[i, 1]
            dx, dy = lines[i, 2] - x, lines[i, 3] - y
            length = np.hypot(dx, dy)
            if length == 0.0:
                continue
            dx, dy = dx / length, dy / length
            for other in range(start[tile], start[tile + 1]):
                j = items[other]
                if owner[i] >= owner[j]:
                    continue
                ax, ay, bx, by = lines[j, 0] - x, lines[j, 1] - y, lines[j, 2] - x, lines[j, 3] - y
                a, b = ax * dx + ay * dy, bx * dx + by * dy
                t0, t1 = max(min(a, b), 0.0), min(max(a, b), length)
                if t1 - t0 <= _BESIDE:
                    continue
                # Where both edges run, the other one lies so far beside this one.
                off, slope = ay * dx - ax * dy, ((by - ay) * dx - (bx - ax) * dy) / (b - a)
                if max(abs(off + (t0 - a) * slope), abs(off + (t1 - a) * slope)) > _BESIDE:
                    continue
                middle = 0.5 * (t0 + t1)
                column = tile_of(x + middle * dx, tiles[0], tiles[2], n_columns)
                if column * n_rows + tile_of(y + middle * dy, tiles[1], tiles[2], n_rows) != tile:
                    continue
                if n < len(borders):
                    p, q = owner[i], owner[j]
                    u, v, w = (
                        planes[p, 0] - planes[q, 0],
                        planes[p, 1] - planes[q, 1],
                        planes[p, 2] - planes[q, 2],
                    )
                    first = u * (x + t0 * dx) + v * (y + t0 * dy) + w
                    last = u * (x + t1 * dx) + v * (y + t1 * dy) + w
                    step = 0.5 * abs(first + last)
                    if first * last < 0.0:
                        step = 0.5 * (first * first + last * last) / abs(first - last)
                    borders[n, 0] = p * len(planes) + q
                    borders[n, 1], borders[n, 2] = t1 - t0, (t1 - t0) * step
                n += 1
    return n
