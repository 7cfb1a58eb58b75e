"""Lines of step edges in plan and the pieces of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.roof_topology.result import StepEdge


class StepLines(NamedTuple):
    """Straight lines in plan, and the pieces of them that are steps."""

    angle: FloatArray  #: direction [rad], shape (n_lines,)
    offset: FloatArray  #: distance from the centre to the left of that direction [m], shape (n_lines,)
    line: IntArray  #: line that each step lies on, shape (n_steps,)
    t: FloatArray  #: its ends along the line [m], shape (n_steps, 2)
    planes: NDArray[np.int32]  #: numbers of the upper and the lower plane, shape (n_steps, 2)
    length: FloatArray  #: length of the border along it [m], shape (n_steps,)
    #: How far the nearest points of the upper roof lie from the line in the mean, or usually [m], shape
    #: (n_lines,).
    gap: FloatArray


def step_edges(
    steps: StepLines, segments: FloatArray, gradients: FloatArray, centre: FloatArray
) -> list[StepEdge]:
    """Return the pieces, whose segments are given, as edges with the heights of their ends."""
    extent = np.hypot(*(segments[:, 1] - segments[:, 0]).T)
    difference = gradients[steps.planes[:, 0] - 1] - gradients[steps.planes[:, 1] - 1]
    rise = np.einsum("kex,kx->ke", segments, difference[:, :2]) + difference[:, 2:]
    columns = (segments + centre[:2], rise.tolist(), steps.planes.tolist(), steps.length.tolist())
    return [
        StepEdge(upper, lower, segment, (first, last), length)
        for is_line, segment, (first, last), (upper, lower), length in zip(
            extent > 0.0, *columns, strict=True
        )
        if is_line
    ]


def step_segments(steps: StepLines) -> FloatArray:
    """Return the ends of all steps about the centre, shape (n_steps, 2, 2) [m]."""
    angle, offset = steps.angle[steps.line], steps.offset[steps.line]
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    left = np.column_stack([-along[:, 1], along[:, 0]])
    return np.asarray((offset[:, None] * left)[:, None] + steps.t[:, :, None] * along[:, None])


def extents_of(steps: StepLines) -> tuple[FloatArray, FloatArray]:
    """Return from where to where each line has pieces [m]; the other way round where it has none."""
    low, high = np.full(len(steps.angle), np.inf), np.full(len(steps.angle), -np.inf)
    np.minimum.at(low, steps.line, steps.t[:, 0])
    np.maximum.at(high, steps.line, steps.t[:, 1])
    return low, high
