"""Draw the picture of the page on eigenvalue features: what the choice of the radius does."""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features
from lidar_buildings.simulation import simulate_tile

#: Pulses a square metre.
DENSITY = 12.0
#: What is drawn, a stepped house and one with a dormer, and by how much these are moved together [m].
LOW, HIGH, CLOSER = np.array([5.0, 85.0]), np.array([100.0, 115.0]), 28.0


def main(picture: Path) -> None:
    """Draw linearity with a small, a large and a chosen radius, and the radii chosen."""
    points = roof_points()
    radii = np.geomspace(1.6, 5.0, 12) * quantised_spacing(points)
    fixed = {
        f"linearity, radius {radius:.1f} m": eigen_features(points, [radius]) for radius in radii[[0, -1]]
    }
    by_shape = eigen_features(points, radii, min_neighbours=9)
    panels = {
        **{title: (found.linearity, "viridis", 1.0) for title, found in fixed.items()},
        "linearity, radius by least entropy": (by_shape.linearity, "viridis", 1.0),
        "that radius [m]": (by_shape.radius, "magma", radii[-1]),
    }
    figure, axes = plt.subplots(2, 2, figsize=(13.0, 7.4), dpi=75, layout="constrained")
    for panel, (title, (values, colours, highest)) in zip(axes.flat, panels.items(), strict=True):
        drawn = panel.scatter(
            points[:, 0], points[:, 1], c=values, s=5.0, cmap=colours, vmin=0.0, vmax=highest, linewidths=0
        )
        figure.colorbar(drawn, ax=panel, shrink=0.8)
        panel.set_title(title, fontsize=10)
        panel.set_aspect("equal")
        panel.set_axis_off()
    save(figure, picture)


def roof_points() -> np.ndarray:
    """Return two roofs as a scanner sees them."""
    tile, truth = simulate_tile("roof_types", density=DENSITY)
    points = tile.points[truth.classification == PointClass.BUILDING]
    points = points[((points[:, :2] > LOW) & (points[:, :2] < HIGH)).all(axis=1)]
    points[points[:, 0] > points[:, 0].mean(), 0] -= CLOSER
    return points


if __name__ == "__main__":
    main(Path(sys.argv[1]))
