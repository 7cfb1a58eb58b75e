"""Draw the picture of the page on regularisation, from the virtual buildings of the tests."""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from bench.scenes.outlines import outline_scene
from lidar_buildings.core.stages.boundary_tracing.tracing import trace_boundary
from lidar_buildings.core.stages.regularisation.config import AS_PUBLISHED, RegularisationConfig
from lidar_buildings.core.stages.regularisation.regularising import regularise_outline
from lidar_buildings.core.stages.regularisation.samples import (
    bearing_points,
    concavity_limits,
    working_spacing,
)

POINTS, TRACED, WALLS, TRUTH = "#b4bac4", "#8d95a3", "#c8472f", "#3f9b58"
#: One per pair of directions; walls in none of them are black.
DIRECTIONS = ("#c8472f", "#2f5f9f", "#d9a01f", "#7a4fa3")
#: A wall whose direction differs by less goes along or across one of the building's [deg].
MAX_DIFFERENCE_DEG = 3.0


def main(picture: Path) -> None:
    """
    Draw bearing points, walls by direction, the published method beside ours, an arc, a yard, and a failure.
    """
    figure, axes = plt.subplots(2, 3, figsize=(13.0, 8.6), dpi=80, layout="constrained")
    draw_bearing_points(axes[0, 0])
    wings = outline_scene("three_wings", density=8.0, rotation_deg=20.0)
    draw_published(axes[0, 1], wings)
    draw(axes[0, 2], wings, "ours: three pairs of directions, one colour each")
    draw(axes[1, 0], outline_scene("apse", density=2.0, rotation_deg=30.0), "an apse is an arc (black)")
    yard = outline_scene("l_with_courtyard", density=2.0, rotation_deg=17.0)
    draw(axes[1, 1], yard, "a courtyard shares the directions of the outer ring")
    holey = outline_scene("rectangle_30_18", density=8.0, rotation_deg=225.0, drop_outs=0.2)
    draw(axes[1, 2], holey, "failure: a fifth of the points lost, a step that is none")
    save(figure, picture, 64)


def draw_bearing_points(axes) -> None:
    """Draw a traced ring, which of its points bear it, and both lines that are fitted."""
    scene = outline_scene("facade_step", density=2.0, rotation_deg=12.0, seed=1)
    traced = trace_boundary(scene.points, point_spacing=scene.spacing).outline
    config = RegularisationConfig()
    ring = traced.exterior
    bears = bearing_points(ring, concavity_limits(config, working_spacing(traced, config)))
    set_up(axes, scene, "bearing points (full); walls, and corrected (dashed)")
    line(axes, ring, TRACED, linewidth=1.0)
    axes.plot(*ring[~bears].T, "o", color="white", markeredgecolor=TRACED, markersize=4)
    axes.plot(*ring[bears].T, "o", color="#2f5f9f", markersize=4)
    line(axes, regularise_outline(traced, config).outline.exterior, WALLS, linewidth=1.4)
    moved = regularise_outline(traced, RegularisationConfig(correct_bias=True))
    line(axes, moved.outline.exterior, WALLS, linestyle="--", linewidth=1.2)
    west, south = scene.truth.bounds[:2]
    axes.set_xlim(west - 1, west + 19)
    axes.set_ylim(south - 1, south + 13)


def draw_published(axes, scene) -> None:
    """Draw what two perpendicular directions make of a building."""
    set_up(axes, scene, "as published: two perpendicular directions (green: truth)")
    line(axes, np.array(scene.truth.exterior.coords)[:-1], TRUTH, linewidth=1.2)
    traced = trace_boundary(scene.points, point_spacing=scene.spacing).outline
    line(axes, regularise_outline(traced, AS_PUBLISHED).outline.exterior, WALLS, linewidth=1.5)


def draw(axes, scene, title) -> None:
    """Draw points, and their walls coloured by direction."""
    set_up(axes, scene, title)
    result = regularise_outline(trace_boundary(scene.points, point_spacing=scene.spacing).outline)
    for ring in result.outline.rings:
        for wall in np.stack([ring, np.roll(ring, -1, axis=0)], axis=1):
            axes.plot(*wall.T, color=colour_of(wall, result.directions), linewidth=2.0)


def colour_of(wall, directions) -> str:
    """Return the colour of the direction that a straight wall goes along or across."""
    heading = np.arctan2(*(wall[1] - wall[0])[::-1])
    for colour, direction in zip(DIRECTIONS, directions, strict=False):
        difference = np.rad2deg(heading - direction + np.pi / 4) % 90.0 - 45.0
        if abs(difference) < MAX_DIFFERENCE_DEG:
            return colour
    return "black"


def set_up(axes, scene, title) -> None:
    """Draw the points of a roof."""
    axes.plot(*scene.points[:, :2].T, ".", color=POINTS, markersize=2)
    axes.set_title(title, fontsize=9)
    axes.set_aspect("equal")
    axes.axis("off")


def line(axes, ring, colour, **style) -> None:
    """Draw a closed ring."""
    axes.plot(*np.vstack([ring, ring[:1]]).T, color=colour, **style)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
