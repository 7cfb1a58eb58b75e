"""Draw the picture of the page on plane fitting, from the simulation's roof shapes."""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from lidar_buildings.core.stages.plane_fitting.config import AS_PUBLISHED, PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.core.stages.plane_fitting.surroundings import survey_points
from lidar_buildings.simulation import roof_shapes

DENSITY, NOISE = 12.0, 0.03
COLOURS = plt.get_cmap("tab20")


def main(picture: Path) -> None:
    """Draw seeds, planes of several roofs, the published method beside ours, and a failure."""
    figure, axes = plt.subplots(2, 3, figsize=(13.0, 8.4), dpi=80, layout="constrained")
    draw_seeds(axes[0, 0])
    hipped = sampled(roof_shapes.hipped_l())
    draw(axes[0, 1], hipped, AS_PUBLISHED, "as published: the first plane takes the seams")
    draw(axes[0, 2], hipped, PlaneFittingConfig(), "ours: connected, settled along the seams")
    cross = sampled(roof_shapes.cross_gable())
    draw(axes[1, 0], cross, PlaneFittingConfig(), "slopes go on across the crossing: four planes")
    draw(axes[1, 1], sampled(roof_shapes.barrel()), PlaneFittingConfig(), "a barrel comes as facets")
    sparse = sampled(roof_shapes.gable_dormer(), density=2.0)
    draw(
        axes[1, 2],
        sparse,
        PlaneFittingConfig(),
        "failure: of slopes of 7 and 11 points one is lost",
    )
    save(figure, picture, 64)


def sampled(building, density: float = DENSITY) -> np.ndarray:
    """Sample a roof, turned, one point somewhere in every square of 1 / density."""
    random = np.random.default_rng(0)
    placed = building.placed(0.0, 0.0, rotation_deg=17.0)
    low, high = placed.exterior.min(axis=0), placed.exterior.max(axis=0)
    step = 1.0 / np.sqrt(density)
    x, y = (a.ravel() for a in np.meshgrid(*(np.arange(a, b, step) for a, b in zip(low, high, strict=True))))
    xy = np.column_stack([x, y]) + random.random((len(x), 2)) * step
    face, z = placed.roof_at(xy)
    return np.column_stack([xy, z + random.normal(0.0, NOISE, len(z))])[face > 0]


def draw_seeds(axis) -> None:
    """Draw which points' surroundings are smooth: those that planes are sought from first."""
    points = sampled(roof_shapes.dormer())
    cloud = survey_points(points, 3.0 / np.sqrt(DENSITY)).cloud
    for chosen, colour, label in (
        (cloud.is_smooth, "#2f5f9f", "first"),
        (~cloud.is_smooth, "#c8472f", "last"),
    ):
        axis.scatter(*cloud.points[chosen, :2].T, s=5, c=colour, linewidths=0, label=label)
    axis.legend(loc="upper right", markerscale=3.0, frameon=False)
    finish(axis, "planes are sought from points without a ridge near")


def draw(axis, points: np.ndarray, config: PlaneFittingConfig, title: str) -> None:
    """Draw planes by colour, points of none in black."""
    plane_id = fit_roof_planes(points, config).plane_id.astype(int)
    colours = COLOURS((plane_id - 1) % 20)
    colours[plane_id == 0] = (0.0, 0.0, 0.0, 1.0)
    axis.scatter(*points[:, :2].T, s=5 if len(points) > 600 else 14, c=colours, linewidths=0)
    finish(axis, title)


def finish(axis, title: str) -> None:
    """Give a map its title, equal axes and no ticks."""
    axis.set_title(title, fontsize=10)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
