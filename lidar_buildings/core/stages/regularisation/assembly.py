"""From the walls of a ring to its corners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.regularisation.joints import (
    PARALLEL,
    extent_of,
    find_joint,
    length_of,
    turn_at,
    turning_point,
)
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.stages.regularisation.walls import N_SHAPE, RADIUS, fit_wall, foot_on
from lidar_buildings.core.surfaces.ring_division.division import Division
from lidar_buildings.core.surfaces.ring_division.moments import running_sums


class Fit(NamedTuple):
    """How walls are fitted and which details are kept."""

    angles: NDArray[np.float64]  #: directions of the walls' normals [rad], shape (n_directions,)
    direction_weight: float  #: weight of these directions, in multiples of the wall's own samples
    min_step: float  #: smallest step that is kept [m]
    shortest: float  #: shortest wall, even where smaller steps are kept [m]
    chord_error: float  #: largest distance of an arc from its chords [m]
    #: What a wall's own line has to save in squared offsets beside one that other walls lie on [m²].
    line_cost: float


class WalledRing(NamedTuple):
    """A ring's walls with what joins them; no walls where no ring is left."""

    #: As in `Division`; samples of walls that were dropped belong to none, shape (n_walls,).
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    kind: NDArray[np.int64]
    shape: NDArray[np.float64]  #: see `walls.ANGLE` to `walls.RADIUS`, shape (n_walls, 5)
    #: The corner between each wall and the next, given twice, or the two ends of the step between them [m],
    #: shape (n_walls, 2, 2).
    joints: NDArray[np.float64]


def assemble(samples: RingSamples, division: Division, fit: Fit) -> WalledRing:
    """
    Fit the walls of a division and join them.

    Consecutive walls are intersected; parallel ones are joined by a perpendicular step, or made one where
    the step is too small. A wall that comes out too short, or the wrong way round, is dropped, the worst
    one first, until all are long enough.
    """
    return WalledRing(
        *_assembled(
            samples.points,
            samples.weights,
            samples.bears,
            division.first,
            division.last,
            division.kind,
            fit.angles,
            fit.direction_weight,
            fit.min_step,
            fit.shortest,
        )
    )


@kernel
def _assembled(points, weights, bears, first, last, kind, angles, direction_weight, min_step, shortest):  # type: ignore[no-untyped-def]
    """Fit, join, drop and fit again until all walls are long enough."""
    sums = running_sums(points, weights)
    first, last, kind = first.copy(), last.copy(), kind.copy()
    m, n = len(first), len(points)
    shape = np.empty((m, N_SHAPE))
    for i in range(m):
        # Walls begin in the first round, so that merged ones end in the second, as far as the sums reach.
        first[i], last[i] = first[i] % n, first[i] % n + last[i] - first[i]
        fit_wall(points, bears, sums, first[i], last[i], kind[i], angles, direction_weight, shape[i])
    joints = np.zeros((m, 2, 2))
    while True:
        m = _merge_parallels(
            points, bears, sums, first, last, kind, shape, m, angles, direction_weight, min_step
        )
        if m == 1 and shape[0, RADIUS] != 0 and last[0] - first[0] >= len(points):
            break
        if m < 2:
            m = 0
            break
        for i in range(m):
            find_joint(points, first, last, shape, i, (i + 1) % m, min_step, shortest, joints[i])
        worst, length = 0, np.inf
        for i in range(m):
            own = length_of(points, first, last, shape, i, joints[i - 1 if i else m - 1, 1], joints[i, 0])
            if own < length:
                worst, length = i, own
        if length >= max(shortest, min_step):
            break
        m = close_rows(first, last, kind, shape, m, worst)
    return first[:m], last[:m], kind[:m], shape[:m], joints[:m]


@kernel
def close_rows(first, last, kind, shape, m, i):  # type: ignore[no-untyped-def]
    """Close the rows over a wall; return how many are left."""
    for k in range(i, m - 1):
        first[k], last[k], kind[k] = first[k + 1], last[k + 1], kind[k + 1]
        for column in range(N_SHAPE):
            shape[k, column] = shape[k + 1, column]
    return m - 1


@kernel
def _merge_parallels(  # type: ignore[no-untyped-def]
    points, bears, sums, first, last, kind, shape, m, angles, direction_weight, min_step
):
    """
    Make consecutive parallel walls one where the step between them is too small; return how many are left.
    """
    n, i = len(points), 0
    while m > 1 and i < m:
        k = (i + 1) % m
        if not _is_continued(points, first, last, shape, i, k, min_step):
            i += 1
            continue
        if last[k] - first[k] > last[i] - first[i]:
            kind[i] = kind[k]
        end = last[k]
        while end <= first[i]:
            end += n
        last[i] = end
        fit_wall(points, bears, sums, first[i], last[i], kind[i], angles, direction_weight, shape[i])
        m = close_rows(first, last, kind, shape, m, k)
        i = max(i - 1, 0) if k else 0
    return m


@kernel
def _is_continued(points, first, last, shape, i, k, min_step):  # type: ignore[no-untyped-def]
    """Whether a wall goes on as the next one in the same direction with hardly a step."""
    if shape[i, RADIUS] != 0 or shape[k, RADIUS] != 0:
        return False
    x, y = turning_point(points, first, last, i, k)
    turn = turn_at(points, first, last, shape, i, k, x, y)
    shorter = min(extent_of(points, first[i], last[i]), extent_of(points, first[k], last[k]))
    if turn > PARALLEL or np.sin(turn) * shorter >= min_step:
        return False
    ax, ay = foot_on(shape[i], x, y)
    bx, by = foot_on(shape[k], x, y)
    return np.hypot(ax - bx, ay - by) < min_step
