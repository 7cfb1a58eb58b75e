"""
Draw the pictures of doc/howto.md: what is wrong, and what cures it, on virtual surveys.

    python -m bench.pages.howto doc/howto
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

from bench.common.plotting import plt
from bench.scenes.terrain import TERRAIN_SCENES
from lidar_buildings import GroundFilterConfig, PipelineConfig, classify_ground, reconstruct_tile
from lidar_buildings.simulation import simulate_tile

#: ASPRS class → colour, and that of outlines.
COLOURS = {1: "#6f7f9a", 2: "#d9cdb4", 4: "#b5c95a", 5: "#4f8a47", 6: "#d9705a", 11: "#8f8578"}
OUTLINE = "#1b1f3a"
#: The noise of a poor scanner [m], and the settings that suit it.
NOISY = {"planimetric_noise": 0.4, "range_noise": 0.15}
ROUGH = {"roof_selection": {"max_roughness": 0.3}}
PLAIN_WALLS = ROUGH | {"regularisation": {"noise": 0.8}}
SPLIT = {"segmentation": {"split_at_steps": True}}
#: Picture → scene, its noise, settings before and after, what is drawn of it (west, south, east, north) [m].
PICTURES = {
    "missing": ("roof_types", NOISY, {}, ROUGH, (0, 0, 200, 160)),
    "jagged": ("roof_types", NOISY, ROUGH, PLAIN_WALLS, (105, 5, 195, 75)),
    "one": ("dense_block", {}, {}, SPLIT, (15, 17, 105, 72)),
}


def main(folder: Path) -> None:
    """Draw all pictures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (scene, noise, before, after, window) in PICTURES.items():
        tile, _ = simulate_tile(scene, 0, **noise)
        aspect = (window[3] - window[1]) / (window[2] - window[0])
        figure, both = plt.subplots(1, 2, figsize=(10, 5 * aspect), dpi=90)
        for axes, settings in zip(both, (before, after), strict=True):
            result = reconstruct_tile(tile, PipelineConfig.from_settings(settings), until="regularisation")
            draw_plan(axes, tile.points, result, window)
        save(figure, folder / f"{name}.png")
    figure, both = plt.subplots(2, 1, figsize=(10, 2.6), dpi=90)
    scene = TERRAIN_SCENES["overpass_with_ramps"]()
    for axes, method in zip(both, ("consensus", "morphological"), strict=True):
        found = classify_ground(scene.points, GroundFilterConfig(method=method)).classification == 2
        draw_profile(axes, scene.points, found)
    save(figure, folder / "ground.png")


def draw_plan(axes: plt.Axes, points: np.ndarray, result, window: tuple[float, ...]) -> None:
    """Draw points by class from above, outlines over them."""
    west, south, east, north = window
    corner = points[:, :2].min(axis=0)
    colours = np.ones((256, 3))
    for code, colour in COLOURS.items():
        colours[code] = to_rgb(colour)
    order = np.argsort(points[:, 2], kind="stable")
    xy, codes = points[order, :2] - corner, result.classified.classification[order]
    axes.scatter(*xy.T, s=0.9, c=colours[codes], linewidths=0, marker="s")
    for building in result.outlines:
        for ring in (building.outline.exterior, *building.outline.holes):
            axes.plot(*(np.vstack([ring, ring[:1]])[:, :2] - corner).T, color=OUTLINE, linewidth=1.6)
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")


def draw_profile(axes: plt.Axes, points: np.ndarray, is_ground: np.ndarray) -> None:
    """Draw what lies along the middle of the road from the side."""
    along = abs(points[:, 1] - 40) < 4
    for rows, code in ((along & is_ground, 11), (along & ~is_ground, 6)):
        axes.scatter(points[rows, 0], points[rows, 2], s=4, c=COLOURS[code], linewidths=0)
    axes.set(xlim=(60, 160), aspect=2)


def save(figure: plt.Figure, path: Path) -> None:
    """Write a picture with few colours, which keeps files small."""
    for axes in figure.axes:
        axes.set_axis_off()
    figure.subplots_adjust(0.005, 0.01, 0.995, 0.99, 0.02, 0.02)
    figure.savefig(path)
    Image.open(path).convert("RGB").quantize(48).save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
