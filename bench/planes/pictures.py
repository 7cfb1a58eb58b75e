"""Pictures of a roof's planes beside the reference's."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

from bench.planes.truth import KnownRoof
from lidar_buildings.evaluation.scores.planes import score_planes

matplotlib.use("Agg")
import matplotlib.pyplot as plt

#: Inches of a picture.
SIZE = (14.0, 7.0)


def colours_of(planes: NDArray[np.int64]) -> NDArray[np.float64]:
    """Give every plane a colour of its own, and points of none black."""
    # The golden ratio keeps the hues of following numbers apart.
    hue = planes * 0.618034 % 1.0
    strength = 0.55 + 0.45 * (planes % 2)
    colours = matplotlib.colors.hsv_to_rgb(np.column_stack([hue, strength, 0.95 - 0.25 * (planes % 3 == 2)]))
    colours[planes <= 0] = 0.0
    return np.asarray(colours)


def draw_planes(path: Path, roof: KnownRoof, found: NDArray[np.int64]) -> None:
    """Draw a roof from above: the reference on the left, what was found on the right."""
    score = score_planes(found, roof.planes)
    figure, axes = plt.subplots(1, 2, figsize=SIZE, layout="constrained")
    titles = (
        f"{roof.name}: reference",
        f"F1 {score.f1:.2f}, weighted coverage {score.weighted_coverage:.2f}",
    )
    for axis, planes, title in zip(axes, (roof.planes, found), titles, strict=True):
        axis.scatter(*roof.points[:, :2].T, s=4, c=colours_of(planes), linewidths=0)
        axis.set_aspect("equal")
        axis.set_title(title)
    figure.savefig(path, dpi=80)
    plt.close(figure)
