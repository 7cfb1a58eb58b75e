"""
Draw the picture of the page on edge labelling: features, the published band, and what thinning leaves of it.
"""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from lidar_buildings.core.stages.edge_labelling.config import AS_PUBLISHED, EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.labelling import label_edges

#: Distance of points along and across the scan [m].
STEPS = (0.45, 0.38)
#: Chance of a pulse to be lost, and its noise [m].
LOST, NOISE = 0.04, 0.03


def main(picture: Path) -> None:
    """Draw linearity, and the edges of three settings."""
    points = roofs()
    settings = {
        "as published: a band, ridges and steps": AS_PUBLISHED,
        'default, thinning = "outline"': EdgeLabellingConfig(),
        'thinning = "surface": steps between roofs, too': EdgeLabellingConfig(thinning="surface"),
    }
    figure, axes = plt.subplots(2, 2, figsize=(13.0, 7.6), dpi=75, layout="constrained")
    for panel in axes.flat:
        panel.set_aspect("equal")
    linearity = label_edges(points).linearity
    shown = axes[0, 0].scatter(points[:, 0], points[:, 1], c=linearity, s=5, vmin=0, vmax=0.8, cmap="viridis")
    figure.colorbar(shown, ax=axes[0, 0], shrink=0.8)
    axes[0, 0].set_title("linearity at the radius of least entropy", fontsize=10)
    for panel, (title, config) in zip(axes.flat[1:], settings.items(), strict=True):
        edge = label_edges(points, config).edge == 1
        panel.scatter(*points[~edge, :2].T, s=2, color="#b8bec6", linewidths=0)
        panel.scatter(*points[edge, :2].T, s=9, color="#c8331e", linewidths=0)
        panel.set_title(f"{title} ({100 * edge.mean():.0f} % of the points)", fontsize=10)
    save(figure, picture, 96)


def roofs() -> np.ndarray:
    """
    Return the roofs of a gable house, a hall with an annex 3 m lower and a roof light, and a row of two.
    """
    plan = scan((0.0, 44.0), (0.0, 24.0))
    x, y = plan.T
    gable = (x > 2) & (x < 14) & (y > 3) & (y < 12)
    hall = (x > 19) & (x < 34) & (y > 3) & (y < 21) & (np.hypot(x - 26, y - 15) > 1.2)
    annex = (x >= 34) & (x < 42) & (y > 3) & (y < 13)
    row = (x > 2) & (x < 14) & (y > 15) & (y < 21)
    z = np.full(len(plan), np.nan)
    z[gable] = 9.0 - 0.9 * np.abs(y[gable] - 7.5)
    z[hall], z[annex] = 9.0, 6.0
    z[row] = np.where(x[row] < 8, 7.0, 7.5)
    found = np.isfinite(z)
    noise = np.random.default_rng(1).normal(0.0, NOISE, len(plan))
    return np.column_stack([plan, z + noise])[found]


def scan(x: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
    """Return where pulses meet the roofs: lines oblique to these, of uneven steps and with gaps."""
    random = np.random.default_rng(0)
    reach = x[1] + y[1]
    lattice = np.meshgrid(np.arange(-reach, reach, STEPS[0]), np.arange(-reach, reach, STEPS[1]))
    grid = np.column_stack([axis.ravel() for axis in lattice])
    grid += random.uniform(-0.2, 0.2, grid.shape) * STEPS
    turn = np.radians(17.0)
    plan = grid @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    inside = (plan >= (x[0], y[0])).all(axis=1) & (plan <= (x[1], y[1])).all(axis=1)
    return plan[inside & (random.random(len(plan)) > LOST)]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
