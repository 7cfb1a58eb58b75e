"""Draw the picture of the page on bidirectional_slope, from synthetic terrain."""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from lidar_buildings.core.stages.ground_filter.bidirectional_slope import net_votes
from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.scan_profiles import cut_profiles

CONFIG = GroundFilterConfig(method="bidirectional_slope")
#: Colours of the maps.
RELIEF, GROUND, REJECTED, ACCEPTED = "#c9ccd2", "#b9a67e", "#c8472f", "#2f5f9f"


def main(picture: Path) -> None:
    """Draw a profile's votes, a scene that comes out right, and two known failures."""
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.6), dpi=90, layout="constrained")
    draw_votes(axes[0, 0])
    draw_errors(axes[0, 1], *town_above_a_cliff(), "houses on both sides of a cliff of 6 m: right")
    draw_errors(axes[1, 0], *hall_in_a_hillside(), "fails: a hall whose roof goes on as the hillside")
    draw_errors(axes[1, 1], *long_low_bank(), "fails: a low hedge with slanting sides, from end to end")
    handles = [
        plt.Line2D([], [], marker="o", linestyle="", color=colour, label=text)
        for text, colour in (
            ("ground", GROUND),
            ("object", RELIEF),
            ("ground rejected", REJECTED),
            ("object accepted", ACCEPTED),
        )
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    save(figure, picture, 128)


def draw_votes(axes: plt.Axes) -> None:
    """Draw one profile over a house, a tree and a terrace, coloured by what both passes say."""
    x = np.arange(0.0, 260.0, 0.9)
    z = 0.02 * x + np.random.default_rng(0).normal(0, 0.05, len(x))
    z[x < 22] += 5.0
    z[(x > 90) & (x < 112)] += 7.0
    tree = (x > 135) & (x < 143)
    z[tree] += np.random.default_rng(1).uniform(2, 8, tree.sum())
    z[x > 190] += 4.0
    points = np.column_stack((x, np.zeros_like(x), z))
    votes = net_votes([cut_profiles(points, 2.0, 0.0)], z, CONFIG)
    axes.plot(x, z, color="#8a8f99", linewidth=0.6)
    for low, high, text, colour in (
        (0.4, 1.0, "ground", "#4f8a47"),
        (-0.6, 0.4, "the passes differ, or one knows nothing", "#e0a458"),
        (-1.1, -0.6, "object both ways", "#c8472f"),
    ):
        chosen = (votes > low) & (votes <= high)
        axes.scatter(x[chosen], z[chosen], s=9, color=colour, label=text)
    axes.set(title="what two passes say: a cut-off house, a house, a tree, a terrace", xlabel="along [m]")
    axes.set(ylabel="elevation [m]")
    axes.legend(frameon=False, fontsize=8, loc="upper left")


def draw_errors(axes: plt.Axes, points: np.ndarray, is_ground: np.ndarray, title: str) -> None:
    """Draw which points were labelled rightly and which were not, in plan."""
    ground = classify_ground(points, CONFIG).classification == 2
    for chosen, colour in (
        (ground & is_ground, GROUND),
        (~ground & ~is_ground, RELIEF),
        (~ground & is_ground, REJECTED),
        (ground & ~is_ground, ACCEPTED),
    ):
        axes.scatter(*points[chosen, :2].T, s=4.0, color=colour, linewidths=0)
    share = 100 * np.mean(ground != is_ground)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=f"{title}\ntotal error {share:.1f} %")


def lattice(width: float, depth: float, spacing: float) -> np.ndarray:
    """Return points in scan order over a level rectangle, with 3 cm of noise."""
    random = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(0.0, width, spacing), np.arange(0.0, depth, spacing))
    xy = np.column_stack((x.ravel(), y.ravel())) + random.uniform(0, 0.4 * spacing, (x.size, 2))
    return np.column_stack((xy, random.normal(0, 0.03, x.size)))


def inside(points: np.ndarray, middle: tuple[float, float], half: tuple[float, float]) -> np.ndarray:
    """Return which points lie in a rectangle."""
    return (np.abs(points[:, :2] - middle) < half).all(axis=1)


def town_above_a_cliff() -> tuple[np.ndarray, np.ndarray]:
    """Return 22 houses on a slope with a cliff across it, and what is ground."""
    points = lattice(160.0, 110.0, 0.8)
    points[:, 2] += 0.08 * points[:, 0] + 6.0 * (points[:, 0] > 70 + 0.2 * points[:, 1])
    random = np.random.default_rng(4)
    roof = np.zeros(len(points), dtype=bool)
    for _ in range(22):
        house = inside(points, random.uniform((0, 0), (160, 110)), random.uniform(4, 10, 2)) & ~roof
        points[house, 2] += random.uniform(3, 9)
        roof |= house
    return points, ~roof


def hall_in_a_hillside() -> tuple[np.ndarray, np.ndarray]:
    """Return a hall whose flat roof meets the slope behind it, and what is ground."""
    points = lattice(160.0, 110.0, 0.8)
    points[:, 2] += 0.25 * points[:, 0]
    hall = inside(points, (80, 55), (18, 24))
    points[hall, 2] = 0.25 * 98.0
    return points, ~hall


def long_low_bank() -> tuple[np.ndarray, np.ndarray]:
    """Return a hedge 4 m wide and 1 m high across a dense cloud, and what is ground."""
    points = lattice(70.0, 48.0, 0.25)
    height = np.clip((2.0 - np.abs(points[:, 1] - 24.0 - 0.1 * points[:, 0])) / 0.8, 0.0, 1.0)
    points[:, 2] += height
    return points, height < 0.35


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "doc/algorithms/bidirectional_slope.png"))
