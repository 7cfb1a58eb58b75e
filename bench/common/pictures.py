"""Maps of where a method and the reference disagree."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from bench.common.plotting import plt

#: Pixels along the longer side of the shaded map, and inches of the picture.
MAP_PIXELS = 700
PICTURE_SIZE = 10.0
#: What is steeper is shaded as if it were this steep, so that walls do not drown the terrain [m/m].
MAX_SHADED_SLOPE = 1.0
#: Elevations that differ less than this are drawn alike [m].
MIN_RELIEF = 2.0
#: Empty pixels further than this from a point stay white [pixels].
MAX_GAP = 3.0


def draw_over_relief(
    path: Path,
    points: NDArray[np.float64],
    groups: Sequence[tuple[str, str, NDArray[np.float64]]],
    title: str,
    side: float | None = None,
) -> None:
    """
    Draw groups of places (colour, name, coordinates [m]) over the relief of a cloud (n_points, 3) [m].

    Places are squares of a `side` [m]; without, dots, the larger the fewer points there are.
    """
    low, extent = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0) + 1e-6
    pixel = max(extent.max() / MAP_PIXELS, np.sqrt(np.prod(extent) / len(points)))
    size, marker = np.clip(1e6 / len(points), 0.25, 10), "o"
    if side is not None:
        # Points of a scatter are 1/72 inch wide.
        size, marker = (72 * 0.95 * PICTURE_SIZE * side / extent[0]) ** 2, "s"
    figure, axes = plt.subplots(figsize=(PICTURE_SIZE, PICTURE_SIZE * (extent[1] / extent[0] * 0.95 + 0.08)))
    bounds = (low[0], low[0] + extent[0], low[1], low[1] + extent[1])
    relief = shaded_relief(points, pixel)
    axes.imshow(relief, origin="lower", extent=bounds, cmap="gray", vmin=0, vmax=1)
    for colour, name, places in groups:
        label = f"{name} ({len(places)})"
        axes.scatter(*places[:, :2].T, s=size, c=colour, marker=marker, linewidths=0, label=label)
    axes.set_title(title)
    axes.legend(loc="upper right", markerscale=3)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def shaded_relief(points: NDArray[np.float64], pixel: float) -> NDArray[np.float64]:
    """
    Grey values from 0 to 1 of the highest point of each pixel; NaN where there are no points near.

    Bright is high, and bright are the slopes that face the north-west.
    """
    column, row = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / pixel).astype(int).T
    highest = np.full((row.max() + 1, column.max() + 1), -np.inf)
    np.maximum.at(highest, (row, column), points[:, 2])
    distance, nearest = distance_transform_edt(np.isinf(highest), return_indices=True)
    surface = highest[tuple(nearest)]
    low, high = np.percentile(surface, (2, 98))
    height = np.clip((surface - low) / max(high - low, MIN_RELIEF), 0, 1)
    padded = np.pad(surface, 1, mode="edge")
    rise = (padded[1:-1, 2:] - padded[1:-1, :-2]) - (padded[2:, 1:-1] - padded[:-2, 1:-1])
    light = np.clip(rise / (2 * pixel) / MAX_SHADED_SLOPE, -1, 1)
    return np.where(distance <= MAX_GAP, 0.25 + 0.4 * height + 0.3 * (light + 1) / 2, np.nan)
