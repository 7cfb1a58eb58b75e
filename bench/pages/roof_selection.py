"""Draw the picture of the page on roof selection: scenes of the tests, method by method."""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from bench.scenes.roofs import ROOF_SCENES, RoofScene
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs

METHODS = ("smooth_patches", "lasclassify", "single_returns")
#: Scene → the window that is shown: x from, to, y from, to [m].
SCENES = {
    "trees_over_roofs": (2, 62, 2, 25),
    "bridges": (2, 78, 4, 38),
    "forest_edge": (26, 64, 4, 24),
    "vehicles": (2, 62, 3, 36),
}
#: (Found as roof, is roof) → colour and name; others are drawn by height.
COLOURS = {
    (True, True): ("#9aa3ad", "roof"),
    (True, False): ("#d0342c", "not roof, accepted"),
    (False, True): ("#1f5fd0", "roof, lost"),
}
#: Heights from which on what is no roof is drawn brightest [m].
BRIGHT = 12.0


def main(picture: Path) -> None:
    """Draw every scene with every method."""
    sizes = [(high_y - low_y) / (high_x - low_x) for low_x, high_x, low_y, high_y in SCENES.values()]
    figure, axes = plt.subplots(
        len(SCENES),
        len(METHODS),
        figsize=(13.0, 4.4 * sum(sizes) + 1.4),
        dpi=75,
        layout="constrained",
        height_ratios=sizes,
    )
    for row, (name, window) in zip(axes, SCENES.items(), strict=True):
        scene = ROOF_SCENES[name]()
        for place, method in zip(row, METHODS, strict=True):
            draw(place, scene, method, window)
            place.set_title(f"{name}, {method}", fontsize=9)
    axes[0, 0].legend(markerscale=6, loc="upper left", fontsize=7)
    save(figure, picture, 64)


def draw(axes: plt.Axes, scene: RoofScene, method: str, window: tuple[float, ...]) -> None:
    """Draw the points seen from above, lower ones first."""
    config = RoofSelectionConfig(method=method)
    result = select_roofs(scene.points, config, **scene.columns)
    found = (result.classification == 6) & ~result.is_facade
    x, y, z = scene.points.T
    low_x, high_x, low_y, high_y = window
    shown = (x > low_x) & (x < high_x) & (y > low_y) & (y < high_y) & scene.is_judged
    other = np.flatnonzero(shown & ~found & ~scene.is_building)
    height = np.clip(scene.columns["height_above_ground"][other] / BRIGHT, 0, 1)
    shade = np.column_stack([0.9 - 0.45 * height, 0.87 - 0.2 * height, 0.8 - 0.5 * height])
    axes.scatter(x[other], y[other], s=1.4, c=shade, linewidths=0)
    for (is_found, is_true), (colour, label) in COLOURS.items():
        rows = np.flatnonzero(shown & (found == is_found) & (scene.is_building == is_true))
        rows = rows[np.argsort(z[rows])]
        axes.scatter(x[rows], y[rows], s=2.2, color=colour, label=label, linewidths=0)
    axes.set(xlim=window[:2], ylim=window[2:], aspect="equal", xticks=[], yticks=[])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
