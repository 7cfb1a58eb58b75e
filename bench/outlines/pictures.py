"""Outlines over their points and their truth, and Table 1 as a plot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import shapely
from numpy.typing import NDArray

from bench.outlines.table1 import PAPER, PAPER_SIGMA, Row, slope_through_origin
from bench.outlines.truth import Verdict

matplotlib.use("Agg")
import matplotlib.pyplot as plt

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


def draw_table_1(path: Path, rows: Sequence[Row]) -> None:
    """Draw σ and largest offset over the spacing: the buildings, their means, the paper's, and a line."""
    figure, panels = plt.subplots(1, 2, figsize=(12, 5), dpi=90)
    longest = 1.1 * max(*(row.score.spacing for row in rows), *(s for s, _ in PAPER.values()))
    for axes, figure_name, member, label in (
        (panels[0], "sigma", "sigma", "σ [m]"),
        (panels[1], "max_offset", "max_offset", "largest offset [m]"),
    ):
        for number, row in enumerate(rows):
            fitted = [one for one in row.buildings if one.is_regular]
            spacing = [one.spacing for one in fitted]
            axes.plot(spacing, [getattr(one, member) for one in fitted], ".", color=f"C{number}", alpha=0.4)
            mean = getattr(row.score, figure_name)
            axes.plot(row.score.spacing, mean, "o", color=f"C{number}", markersize=9, label=row.name)
        slope, _ = slope_through_origin(rows, figure_name)
        axes.plot([0, longest], [0, slope * longest], color="0.4", label=f"{slope:.3f} · spacing")
        axes.set(xlabel="point spacing [m]", ylabel=label, xlim=(0, longest), ylim=(0, None))
    low, high = PAPER_SIGMA
    ends = [0, longest]
    panels[0].fill_between(ends, [0, low * longest], [0, high * longest], color="0.9", label="paper")
    panels[1].plot(*zip(*PAPER.values(), strict=True), "k*", markersize=12, label="paper")
    for axes in panels:
        axes.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, metadata={"Software": None})
    plt.close(figure)
