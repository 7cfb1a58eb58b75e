"""The point spacing that a survey's tiles are expected to have."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.io.clouds.point_columns import last_returns
from lidar_buildings.io.tiling.tile_grid import Rectangle

#: Side of the square in the middle of a file in which its spacing is measured [m];
#: wide margin: 90,000 pulses at 1/m².
_SAMPLE_SIDE = 300.0
#: A square with fewer pulses says too little: the standard error of a density is 3 % from here on.
_MIN_PULSES = 1000


def sample_square(area: Rectangle, side: float = _SAMPLE_SIDE) -> Rectangle:
    """Return the square of a side [m] in the middle of a file's bounds."""
    x, y = (area.x_min + area.x_max) / 2, (area.y_min + area.y_max) / 2
    return Rectangle(x, y, x, y).grown(side / 2)


def expected_spacing(samples: Iterable[NDArray[np.float64]]) -> float | None:
    """Measure the spacing [m] of sampled pulses; None where there are too few."""
    gathered = [sample for sample in samples if len(sample)]
    sample = np.concatenate(gathered) if gathered else np.empty((0, 3))
    return measure_spacing(sample) if len(sample) >= _MIN_PULSES else None


def pulses_of(records: NDArray[Any]) -> NDArray[np.float64]:
    """Return the positions of the last returns of records [m]."""
    points = np.column_stack([records[name] for name in "xyz"]).astype(np.float64)
    return last_returns(points, records["return_number"], records["number_of_returns"])
