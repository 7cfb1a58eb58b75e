"""Sampath and Shan 2007: Table 1, and the steps of Figure 4."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely

from bench.outlines import table1
from bench.outlines.chain import Building
from bench.papers.presets import config_of

#: Buildings of the figure, as in the paper.
N_DRAWN = 3


def report(data: Path, folder: Path | None) -> None:
    """Print the table; draw the figure into a folder if one is given."""
    configs = config_of("sampath_shan")
    print("Table 1:")
    rows = table1.report(data, configs)
    if folder is not None:
        for row in rows[:3]:
            _draw(folder / f"sampath_shan_figure_4_{row.name.replace(' ', '_')}.png", row.buildings[:N_DRAWN])


def _draw(path: Path, buildings: list[Building]) -> None:
    """Draw the ring's points, their convex hull, the traced and the regularised boundary."""
    from bench.common.plotting import plt

    figure, axes = plt.subplots(3, len(buildings), figsize=(7 * len(buildings), 18), squeeze=False)
    for column, one in zip(axes.T, buildings, strict=True):
        traced = one.traced.exterior
        hull = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(traced)))
        for panel, (name, ring) in zip(
            column,
            {"convex hull": hull, "traced": traced, "regularised": one.outline.exterior}.items(),
            strict=True,
        ):
            closed = np.vstack((ring, ring[:1]))
            panel.plot(*traced.T, ".", color="grey", markersize=3)
            panel.plot(*closed.T, color="tab:blue")
            panel.set(aspect="equal", title=f"{name}: d = {one.max_offset:.2f} m, σ = {one.sigma:.2f} m")
    figure.savefig(path, dpi=60, bbox_inches="tight")
    plt.close(figure)
