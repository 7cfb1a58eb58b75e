"""Short steps between dangling ends: the cheeks of small dormers, too short for a line of their own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.stages.roof_topology.obstacles import is_far, walls_about
from lidar_buildings.core.stages.roof_topology.result import IntersectionSegment, StepEdge

#: Ends dangle if no other line is so near; two of them belong together if they are so near [spacings].
_HELD, _TOGETHER = 0.1, 5.0
#: Cosine of the sharpest angle between a line and what leads on from its end.
_TURN_BACK = 0.3


def with_joined_dangles(
    intersections: Sequence[IntersectionSegment],
    steps: Sequence[StepEdge],
    gradients: FloatArray,
    rings: tuple[FloatArray, ...],
    centre: FloatArray,
    spacing: float,
) -> list[StepEdge]:
    """
    Return the steps and further ones between dangling ends of lines between the same two planes.

    Parameters
    ----------
    intersections : sequence of IntersectionSegment
    steps : sequence of StepEdge
    gradients : ndarray of shape (n_planes, 3)
        a, b, c of the planes about the centre.
    rings : tuple of ndarray of shape (n, 2)
        The outline's [m].
    centre : ndarray of shape (2 or more,)
        [m].
    spacing : float
        Point spacing [m].
    """
    segments = [line.segment[:, :2] for line in intersections] + [step.segment for step in steps]
    pairs = [(line.first, line.second) for line in intersections]
    pairs += [(min(step.upper, step.lower), max(step.upper, step.lower)) for step in steps]
    if not segments:
        return list(steps)
    lines = np.array(segments) - centre[:2]
    dangling = _dangling(lines, np.concatenate([lines, walls_about(rings, centre)]), _HELD * spacing)
    by_pair: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for number, end in np.argwhere(dangling):
        by_pair.setdefault(pairs[number], []).append((int(number), int(end)))
    edges = list(steps)
    for (i, j), ends in by_pair.items():
        for one, other in _couples(lines, ends, _TOGETHER * spacing):
            edges.append(_edge(np.array([lines[one], lines[other]]), i, j, gradients, centre))
    return edges


@kernel
def _dangling(lines, obstacles, reach):  # type: ignore[no-untyped-def]
    """
    Return which ends of lines have none of the obstacles near; the first obstacles are the lines themselves.
    """
    dangling = np.ones((len(lines), 2), dtype=np.bool_)
    for k in range(len(lines)):
        for end in range(2):
            x, y = lines[k, end, 0], lines[k, end, 1]
            for m in range(len(obstacles)):
                ax, ay = obstacles[m, 0, 0], obstacles[m, 0, 1]
                if is_far(x, y, ax, ay, obstacles[m, 1, 0], obstacles[m, 1, 1], 2.0 * reach):
                    continue
                dx, dy = obstacles[m, 1, 0] - ax, obstacles[m, 1, 1] - ay
                square = dx * dx + dy * dy
                share = ((x - ax) * dx + (y - ay) * dy) / square if square > 0.0 else 0.0
                share = min(max(share, 0.0), 1.0)
                if m != k and math.hypot(ax + share * dx - x, ay + share * dy - y) <= reach:
                    dangling[k, end] = False
                    break
    return dangling


def _couples(
    lines: FloatArray, ends: list[tuple[int, int]], reach: float
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Couple the ends of different lines, the nearest first."""
    candidates = []
    for k, one in enumerate(ends):
        for other in ends[:k]:
            distance = float(np.hypot(*(lines[one] - lines[other])))
            if one[0] != other[0] and distance <= reach and _lead_on(lines, one, other):
                candidates.append((distance, one, other))
    couples: list[tuple[tuple[int, int], tuple[int, int]]] = []
    used: set[tuple[int, int]] = set()
    for _, one, other in sorted(candidates):
        if not {one, other} & used:
            couples.append((one, other))
            used |= {one, other}
    return couples


def _lead_on(lines: FloatArray, one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether the way between two ends turns back along neither of the lines that end there."""
    for here, there in ((one, other), (other, one)):
        outward, onward = lines[here] - lines[here[0], 1 - here[1]], lines[there] - lines[here]
        if outward @ onward < -_TURN_BACK * np.hypot(*outward) * np.hypot(*onward):
            return False
    return True


def _edge(segment: FloatArray, i: int, j: int, gradients: FloatArray, centre: FloatArray) -> StepEdge:
    difference = gradients[i - 1] - gradients[j - 1]
    rise = segment @ difference[:2] + difference[2]
    if rise.sum() < 0:
        i, j, rise = j, i, -rise
    length = float(np.hypot(*(segment[1] - segment[0])))
    return StepEdge(i, j, segment + centre[:2], (float(rise[0]), float(rise[1])), length)
