"""
Draw the pictures of the gallery from virtual buildings, of which nothing but points and outline is used.

    python -m bench.pages.gallery doc/gallery

It needs Pillow beside the package. Every picture is made anew in about a minute.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from bench.pages.draw_models import View, draw_solids
from bench.scenes.models import BAD_SCENES, model_scene
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.stages.building_model import build_model
from lidar_buildings.core.stages.plane_fitting import fit_roof_planes
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.simulation import make_scene, simulate_tile

#: Roofs of the first picture, in rows of `PER_ROW`.
ROOFS = (
    *("flat", "shed", "gable", "half_hip", "hip", "pyramid", "l_shape", "t_shape", "hipped_l", "cross_gable"),
    *("double_gable", "gambrel", "mansard", "dormer", "gable_dormer", "step", "sawtooth", "barrel"),
    *("pointed_tower", "church", "parapet", "courtyard", "pitched_courtyard", "round_tower"),
)
PER_ROW = 6
#: How the houses of the first two pictures are turned, and how many points lie on them.
ROTATION_DEG, DENSITY = 28.0, 8.0
#: Side of a picture of one building [pixels], and colours of the planes that points lie on.
TILE = 220
PLANES = (
    np.array(
        [
            *((31, 119, 180), (255, 127, 14), (44, 160, 44), (214, 39, 40), (148, 103, 189), (140, 86, 75)),
            *((227, 119, 194), (23, 190, 207), (188, 189, 34)),
        ]
    )
    / 255
)
NO_PLANE = np.array((90, 90, 90)) / 255
LEVELS = ("1.2", "1.3", "2.2")
NOTHING = np.full((20, 20, 3), 255, dtype=np.uint8)


def main(folder: Path) -> None:
    """Draw all pictures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    save(roofs_picture(), folder / "roofs.png")
    save(levels_picture(), folder / "levels.png")
    save(bad_picture(), folder / "bad_input.png")
    save(village_picture(), folder / "village.png")


def save(picture: np.ndarray, path: Path) -> None:
    """Write a picture with few colours, which keeps files small."""
    image = Image.fromarray(picture).convert("P", palette=Image.Palette.ADAPTIVE, colors=96)
    image.save(path, optimize=True)


def modelled(scene) -> tuple[dict[str, Solid], np.ndarray]:
    """Return a scene's solids by level of detail, and the plane that was found for each point."""
    planes = fit_roof_planes(scene.points)
    number = planes.plane_id if scene.given_planes is None else scene.given_planes
    model = build_model(scene.points, scene.outline, plane_id=number, ground_elevation=scene.ground_elevation)
    return model.solids, planes.plane_id


def roofs_picture() -> np.ndarray:
    """Draw the finest model of every roof."""
    tiles = []
    for name in ROOFS:
        solids, _ = modelled(model_scene(name, density=DENSITY, rotation_deg=ROTATION_DEG))
        level = max(solids)
        note = "" if level == LEVELS[-1] else f" (LoD{level})"
        tiles.append(titled(draw_solids([solids[level]], View(width=TILE)), name.replace("_", " ") + note))
    return grid(tiles, PER_ROW)


def levels_picture() -> np.ndarray:
    """
    Draw points by plane and the three levels of detail of three buildings, a missing level as an empty place.
    """
    rows = []
    for name in ("gable_dormer", "church", "step"):
        scene = model_scene(name, density=DENSITY, rotation_deg=ROTATION_DEG)
        solids, number = modelled(scene)
        view = View(width=TILE + 40)
        colours = np.where(number[:, None] > 0, PLANES[(number - 1) % len(PLANES)], NO_PLANE)
        finest = solids[max(solids)]
        # The points stand before the roof that they lie on.
        lifted = scene.points + 0.25 * view.axes()[2]
        rows.append(titled(draw_solids([finest], view, lifted, colours), "points by plane"))
        rows += [
            titled(draw_solids([solids[level]], view), f"LoD{level}") if level in solids else NOTHING
            for level in LEVELS
        ]
    return grid(rows, 1 + len(LEVELS))


def bad_picture() -> np.ndarray:
    """Draw what comes of hard and bad input, with the points that there were."""
    tiles = []
    for name, make in BAD_SCENES.items():
        scene = make(density=DENSITY, rotation_deg=ROTATION_DEG)
        solids, _ = modelled(scene)
        level = max(solids)
        colours = np.tile(PLANES[0], (len(scene.points), 1))
        view = View(width=TILE)
        lifted = scene.points + 0.25 * view.axes()[2]
        picture = draw_solids([solids[level]], view, lifted, colours)
        tiles.append(titled(picture, f"{name.replace('_', ' ')}: LoD{level}"))
    return grid(tiles, 4)


def village_picture() -> np.ndarray:
    """Draw the models that the whole chain makes of the virtual village's raw points."""
    tile, _ = simulate_tile(make_scene("village", 0))
    result = reconstruct_tile(tile)
    solids = [one.model.solids[max(one.model.solids)] for one in result.models if one.model.solids]
    return draw_solids(solids, View(width=1200, tilt_deg=45.0))


def titled(picture: np.ndarray, title: str) -> np.ndarray:
    """Put a line of text under a picture."""
    image = Image.new("RGB", (picture.shape[1], picture.shape[0] + 20), "white")
    image.paste(Image.fromarray(picture))
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=13)
    width = draw.textlength(title, font=font)
    draw.text(((image.width - width) / 2, picture.shape[0] + 2), title, fill=(40, 40, 40), font=font)
    return np.asarray(image)


def grid(tiles: list[np.ndarray], per_row: int) -> np.ndarray:
    """Lay pictures out in rows, each in the middle of its cell."""
    width = max(tile.shape[1] for tile in tiles)
    rows = []
    for start in range(0, len(tiles), per_row):
        row = tiles[start : start + per_row]
        height = max(tile.shape[0] for tile in row)
        cells = [np.full((height, width, 3), 255, dtype=np.uint8) for _ in range(per_row)]
        for cell, tile in zip(cells, row, strict=False):
            left = (width - tile.shape[1]) // 2
            cell[height - tile.shape[0] :, left : left + tile.shape[1]] = tile
        rows.append(np.hstack(cells))
    return np.vstack(rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
