"""Maps of where a filter and the reference disagree."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from bench.common.clouds import Cloud

matplotlib.use("Agg")
import matplotlib.pyplot as plt

#: Pixels along the longer side of the shaded map, and inches of the picture.
MAP_PIXELS = 700
PICTURE_SIZE = 10.0
#: Inches of a picture of labels, which shows single points.
EDGE_PICTURE_SIZE = 16.0
#: What is steeper is shaded as if it were this steep, so that walls do not drown the terrain [m/m].
MAX_SHADED_SLOPE = 1.0
#: Elevations that differ less than this are drawn alike [m].
MIN_RELIEF = 2.0
#: Empty pixels further than this from a point stay white [pixels].
MAX_GAP = 3.0


def draw_disagreement(path: Path, cloud: Cloud, mask: NDArray[np.bool_], title: str) -> None:
    """
    Draw ground taken for object (type I, red) and object taken for ground (type II, blue) over the relief.
    """
    xy, low = cloud.points[:, :2], cloud.points[:, :2].min(axis=0)
    extent = np.ptp(xy, axis=0) + 1e-6
    area = float(np.prod(extent))
    pixel = max(extent.max() / MAP_PIXELS, np.sqrt(area / max(len(xy), 1)))
    figure, axes = plt.subplots(figsize=(PICTURE_SIZE, PICTURE_SIZE * (extent[1] / extent[0] * 0.95 + 0.08)))
    axes.imshow(
        shaded_relief(cloud.points, pixel),
        origin="lower",
        extent=(low[0], low[0] + extent[0], low[1], low[1] + extent[1]),
        cmap="gray",
        vmin=0,
        vmax=1,
    )
    size = np.clip(2e6 / max(len(xy), 1), 0.5, 20) / 2
    for rows, colour, name in (
        (cloud.is_ground & ~mask, "red", "type I: ground taken for object"),
        (~cloud.is_ground & mask, "blue", "type II: object taken for ground"),
    ):
        axes.scatter(*xy[rows].T, s=size, c=colour, linewidths=0, label=f"{name} ({rows.sum()})")
    axes.set_title(title)
    axes.legend(loc="upper right", markerscale=3)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_edges(
    path: Path, points: NDArray[np.float64], edge: NDArray[np.bool_], truth: NDArray[np.bool_], title: str
) -> None:
    """Draw roof points in plan: edges found (black), missed (red), extra (blue), and the others (grey)."""
    extent = np.ptp(points[:, :2], axis=0) + 1e-6
    height = EDGE_PICTURE_SIZE * (extent[1] / extent[0] * 0.95 + 0.05)
    figure, axes = plt.subplots(figsize=(EDGE_PICTURE_SIZE, min(height, 2 * EDGE_PICTURE_SIZE)))
    size = np.clip(4e5 / len(points), 0.3, 12)
    for rows, colour, name in (
        (~edge & ~truth, "0.82", "no edge in either"),
        (edge & truth, "black", "edge in both"),
        (~edge & truth, "red", "edge missed"),
        (edge & ~truth, "tab:blue", "edge too many"),
    ):
        axes.scatter(*points[rows, :2].T, s=size, c=colour, linewidths=0, label=f"{name} ({rows.sum()})")
    axes.set(title=title, aspect="equal")
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
