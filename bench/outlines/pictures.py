"""Outlines over their points and their truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.plotting import plt
from bench.outlines.truth import Verdict

#: Columns of a sheet of scenes.
COLUMNS = 6
#: Width of a map [inches].
MAP_SIZE = 14.0


def draw_scenes(path: Path, verdicts: Mapping[str, Verdict]) -> None:
    """Draw one scene per plan: points grey, truth red, result black."""
    rows = -(-len(verdicts) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(4 * COLUMNS, 4 * rows), squeeze=False)
    for place in axes.flat:
        place.axis("off")
    for place, (name, one) in zip(axes.flat, verdicts.items(), strict=False):
        place.scatter(*one.scene.points[:, :2].T, s=1, color="0.7", linewidths=0)
        draw_rings(place, [one.scene.truth], color="red", linewidth=0.8)
        draw_rings(place, [one.polygon], color="black", linewidth=1.2, marker=".", markersize=4)
        corners = (
            "" if one.scene.n_corners is None else f", {one.n_vertices} of {one.scene.n_corners} corners"
        )
        place.set_title(f"{name} {one.scene.rotation_deg:g}°: IoU {one.iou:.3f}{corners}", fontsize=9)
        place.set_aspect("equal")
    figure.tight_layout()
    figure.savefig(path, dpi=70)
    plt.close(figure)


def draw_map(
    path: Path,
    points: NDArray[np.float64],
    layers: Mapping[str, tuple[Sequence[Any], str]],
    limits: tuple[float, float, float, float],
) -> None:
    """Draw roof points in plan and named layers of outlines (polygons, colour) over them."""
    west, south, east, north = limits
    figure, axes = plt.subplots(figsize=(MAP_SIZE, MAP_SIZE * (north - south) / (east - west)))
    inside = (points[:, :2] > (west, south)).all(axis=1) & (points[:, :2] < (east, north)).all(axis=1)
    axes.scatter(*points[inside, :2].T, s=0.3, c=points[inside, 2], cmap="viridis", linewidths=0)
    for name, (polygons, colour) in layers.items():
        draw_rings(axes, polygons, color=colour, linewidth=1.1)
        axes.plot([], [], color=colour, label=name)
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    axes.legend(loc="upper right")
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)


def draw_rings(axes: plt.Axes, polygons: Sequence[Any], **look: Any) -> None:
    """Draw all rings of some polygons."""
    for ring in shapely.get_rings(shapely.get_parts(np.array(polygons, dtype=object))):
        axes.plot(*shapely.get_coordinates(ring).T, **look)
