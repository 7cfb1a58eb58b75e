"""Walls of one ring that lie on one line, as on both sides of an annex, a bay or a recess."""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.regularisation.assembly import Fit, WalledRing
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.stages.regularisation.walls import ANGLE, OFFSET, foot_on
from lidar_buildings.core.surfaces.ring_division.moments import running_sums, scatter_of


class _Line(NamedTuple):
    """Where walls of one direction lie: in the mean across it [m], with what weight, and which these are."""

    position: float
    weight: float
    walls: list[int]

    def cost_with(self, other: _Line) -> float:
        """By how much the squared offsets of all samples rise on one line [m²]."""
        shared = self.weight * other.weight / (self.weight + other.weight)
        return shared * (self.position - other.position) ** 2

    def with_walls_of(self, other: _Line) -> _Line:
        """Return the line in the middle of all samples."""
        weight = self.weight + other.weight
        position = (self.position * self.weight + other.position * other.weight) / weight
        return _Line(position, weight, self.walls + other.walls)


def on_common_lines(samples: RingSamples, walled: WalledRing, fit: Fit) -> NDArray[np.float64]:
    """
    Return the shapes of walls, those on one line if that costs less than lines of their own.

    Walls of one direction with the building on the same side of them are joined, the nearest first, as long
    as the squared offsets rise by less than what a line of its own has to save. Beyond Sampath & Shan (2007),
    whose hierarchy ends with the walls.
    """
    shape = walled.shape.copy()
    for angle, lines in _lines_by_direction(samples, walled, fit):
        for line in _joined(lines, fit.line_cost):
            if len(line.walls) > 1:
                shape[line.walls, ANGLE], shape[line.walls, OFFSET] = angle, line.position
    return shape


def _lines_by_direction(
    samples: RingSamples, walled: WalledRing, fit: Fit
) -> list[tuple[float, list[_Line]]]:
    """Return the lines of walls that share a direction and a side, with its angle [rad], in order."""
    found: dict[tuple[int, bool], list[_Line]] = defaultdict(list)
    points, sums = samples.points, running_sums(samples.points, samples.weights)
    for wall, (first, last, kind) in enumerate(zip(*(one.tolist() for one in walled[:3]), strict=True)):
        if kind < 0:
            continue
        c, s = np.cos(fit.angles[kind]), np.sin(fit.angles[kind])
        dx, dy = points[last % len(points)] - points[(first - 1) % len(points)]
        weight, x, y, *_ = scatter_of(sums, first, last)
        x, y = foot_on(walled.shape[wall], x, y)
        found[kind, bool(dx * s > dy * c)].append(_Line(float(x * c + y * s), weight, [wall]))
    return [(fit.angles[kind], sorted(lines)) for (kind, _), lines in found.items() if len(lines) > 1]


def _joined(lines: list[_Line], least: float) -> list[_Line]:
    """Join neighbours as long as that costs less, the cheapest first."""
    while len(lines) > 1:
        costs = [one.cost_with(other) for one, other in pairwise(lines)]
        k = int(np.argmin(costs))
        if costs[k] >= least:
            break
        lines = [*lines[:k], lines[k].with_walls_of(lines[k + 1]), *lines[k + 2 :]]
    return lines
