"""Maps of where roof selection and the reference disagree."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

from bench.common.pictures import MAP_PIXELS, PICTURE_SIZE, shaded_relief

matplotlib.use("Agg")
import matplotlib.pyplot as plt

#: Colour and name of what is drawn over the relief, in this order.
KINDS = (("0.85", "roof in both"), ("red", "roof here only"), ("blue", "roof of the reference only"))


def draw_roofs(
    path: Path,
    points: NDArray[np.float64],
    mask: NDArray[np.bool_],
    is_building: NDArray[np.bool_],
    title: str,
) -> None:
    """Draw the points on which method and reference agree (grey) and disagree (red, blue) over the relief."""
    low, extent = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0) + 1e-6
    pixel = max(extent.max() / MAP_PIXELS, np.sqrt(np.prod(extent) / max(len(points), 1)))
    size = np.clip(2e6 / max(len(points), 1), 0.5, 20) / 2
    axes = _axes(shaded_relief(points, pixel), low, extent, title)
    chosen = (mask & is_building, mask & ~is_building, ~mask & is_building)
    for (colour, name), rows in zip(KINDS, chosen, strict=True):
        label = f"{name} ({rows.sum()})"
        axes.scatter(*points[rows, :2].T, s=size, c=colour, linewidths=0, label=label)
    _save(axes, path)


def draw_cells(
    path: Path,
    points: NDArray[np.float64],
    agreement: Sequence[NDArray[np.float64]],
    cell: float,
    title: str,
) -> None:
    """Draw the cells in both, in the result only and in the reference only, given by their centres."""
    centres = np.concatenate(agreement)
    low, extent = centres.min(axis=0) - 5.0, np.ptp(centres, axis=0) + 10.0
    near = ((points[:, :2] >= low) & (points[:, :2] <= low + extent)).all(axis=1)
    axes = _axes(shaded_relief(points[near], cell), points[near, :2].min(axis=0), extent, title)
    # Points of a scatter are 1/72 inch wide.
    size = (72 * 0.95 * PICTURE_SIZE * cell / extent[0]) ** 2
    for (colour, name), xy in zip(KINDS, agreement, strict=True):
        axes.scatter(*xy.T, s=size, c=colour, marker="s", linewidths=0, label=f"{name} ({len(xy)})")
    _save(axes, path)


def _axes(relief: NDArray[np.float64], low: NDArray[np.float64], extent: NDArray[np.float64], title: str):
    """Start a map with the relief."""
    height = PICTURE_SIZE * (extent[1] / extent[0] * 0.95 + 0.08)
    _, axes = plt.subplots(figsize=(PICTURE_SIZE, height))
    bounds = (low[0], low[0] + extent[0], low[1], low[1] + extent[1])
    axes.imshow(relief, origin="lower", extent=bounds, cmap="gray", vmin=0, vmax=1)
    axes.set_title(title)
    return axes


def _save(axes, path: Path) -> None:
    axes.legend(loc="upper right", markerscale=3)
    axes.figure.tight_layout()
    axes.figure.savefig(path, dpi=110)
    plt.close(axes.figure)
