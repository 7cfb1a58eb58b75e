"""Draw the picture of the page on the morphological filter: scenes of the tests on which it fails."""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from bench.scenes.terrain import TERRAIN_SCENES
from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig

#: Scene → what to see, and along which axis and where its profile is cut, as a share of its extent.
FAILURES = {
    "large_hall": ("hall: wider than the largest disc", 0, 0.5),
    "steep_forest": ("undergrowth: the tolerance grows with the slope", 1, 0.5),
    "mountain_ridge": ("sharp ridge: cut off as an object would be", 1, 0.5),
}
#: (Found as ground, is ground) → colour and name.
COLOURS = {
    (True, True): ("#b9a57c", "ground"),
    (False, False): ("#7f8fa6", "object"),
    (False, True): ("#d0342c", "ground rejected (type I)"),
    (True, False): ("#1f5fd0", "object accepted (type II)"),
}
#: Half the width of the strip that the profile shows [m].
HALF_STRIP = 1.5


def main(picture: Path) -> None:
    """Draw every failure in plan and in profile."""
    save(draw_scenes(FAILURES, GroundFilterConfig(method="morphological")), picture)


def draw_scenes(scenes: dict[str, tuple[str, int, float]], config: GroundFilterConfig) -> plt.Figure:
    """Draw scenes of the tests in plan and in profile, and how often a filter is wrong on them."""
    size = 4.25 * len(scenes), 7.2
    figure, axes = plt.subplots(2, len(scenes), figsize=size, dpi=75, layout="constrained")
    for column, (name, (title, axis, share)) in zip(axes.T, scenes.items(), strict=True):
        points, truth = TERRAIN_SCENES[name]()
        found = classify_ground(points, config).classification == 2
        at = points[:, axis].min() + share * np.ptp(points[:, axis])
        in_strip = np.abs(points[:, axis] - at) < HALF_STRIP
        draw(column[0], points[:, 0], points[:, 1], found, truth)
        draw(column[1], points[in_strip, 1 - axis], points[in_strip, 2], found[in_strip], truth[in_strip])
        (column[0].axvline if axis == 0 else column[0].axhline)(at, color="black", linewidth=0.6)
        column[0].set_title(f"{title}\ntotal error {100 * np.mean(found != truth):.2f} %", fontsize=10)
        column[0].set_aspect("equal")
    axes[1, 0].legend(markerscale=6, loc="center right", fontsize=8)
    return figure


def draw(axes: plt.Axes, across: np.ndarray, up: np.ndarray, found: np.ndarray, truth: np.ndarray) -> None:
    """Draw points coloured by what was found and what is true."""
    for (is_found, is_true), (colour, label) in COLOURS.items():
        chosen = (found == is_found) & (truth == is_true)
        axes.scatter(across[chosen], up[chosen], s=1.0, color=colour, label=label, linewidths=0)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
