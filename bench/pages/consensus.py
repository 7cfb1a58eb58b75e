"""
Draw the picture of the page on the majority of three: scenes of the tests it masters, and two it does not.

It needs matplotlib (``pip install matplotlib``) beside the package:

    python -m bench.pages.consensus doc/algorithms/consensus.png
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from PIL import Image

from bench.pages.morphological import HALF_STRIP, draw
from bench.scenes.terrain import TERRAIN_SCENES
from lidar_buildings.core.stages.ground_filter import classify_ground

#: Scene → what to see, and along which axis and where its profile is cut, as a share of its extent.
SCENES = {
    "bridge_over_cut": ("bridge: its deck is climbed in part", 0, 0.5),
    "quarry": ("quarry: cliffs and diggers", 0, 0.5),
    "hall_in_hillside": ("hall in a hillside: climbed from the back", 0, 0.5),
    "steep_forest": ("undergrowth on 30 to 40°", 1, 0.5),
}


def main(picture: Path) -> None:
    """Draw every scene in plan and in profile."""
    figure, axes = plt.subplots(2, len(SCENES), figsize=(16.0, 7.0), dpi=72, layout="constrained")
    for column, (name, (title, axis, share)) in zip(axes.T, SCENES.items(), strict=True):
        points, truth = TERRAIN_SCENES[name]()
        found = classify_ground(points).classification == 2
        at = points[:, axis].min() + share * np.ptp(points[:, axis])
        in_strip = np.abs(points[:, axis] - at) < HALF_STRIP
        draw(column[0], points[:, 0], points[:, 1], found, truth)
        draw(column[1], points[in_strip, 1 - axis], points[in_strip, 2], found[in_strip], truth[in_strip])
        (column[0].axvline if axis == 0 else column[0].axhline)(at, color="black", linewidth=0.6)
        column[0].set_title(f"{title}\ntotal error {100 * np.mean(found != truth):.2f} %", fontsize=10)
        column[0].set_aspect("equal")
    axes[1, 0].legend(markerscale=6, loc="center right", fontsize=8)
    figure.savefig(picture)
    Image.open(picture).convert("P", palette=Image.Palette.ADAPTIVE, colors=64).save(picture, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
