"""
Draw the pictures of the gallery from virtual buildings, of which nothing but points and outline is used.

    python -m bench.pages.gallery doc/gallery

It needs Pillow and Open3D (extra [bench]) beside the package.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from bench.scenes.models import BAD_SCENES, model_scene
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.io.models.cityjson import feature_line, load_feature
from lidar_buildings.report.contents import model_arrays
from lidar_buildings.report.view.drawing import picture_of
from lidar_buildings.report.view.parts import Coloured, models_of

#: Roofs of the first picture, in rows of `PER_ROW`.
ROOFS = (
    *("flat", "shed", "gable", "half_hip", "hip", "pyramid", "l_shape", "t_shape", "hipped_l", "cross_gable"),
    *("double_gable", "gambrel", "mansard", "dormer", "gable_dormer", "step", "sawtooth", "barrel"),
    *("pointed_tower", "church", "parapet", "courtyard", "pitched_courtyard", "round_tower"),
)
PER_ROW = 6
#: How the houses of the first two pictures are turned, and how many points lie on them.
ROTATION_DEG, DENSITY = 28.0, 8.0
#: Of a picture of one building [pixels]; points lie this far towards the eye [m]; colours of their planes.
SIZE, LIFT = (230, 190), np.array([-0.14, -0.14, 0.14])
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


def save(picture: np.ndarray, path: Path) -> None:
    """Write a picture with few colours, which keeps files small."""
    image = Image.fromarray(picture).convert("P", palette=Image.Palette.ADAPTIVE, colors=96)
    image.save(path, optimize=True)


def modelled(scene) -> tuple[BuildingModel, np.ndarray]:
    """Return a scene's model, and the plane that was found for each point."""
    planes = fit_roof_planes(scene.points)
    number = planes.plane_id if scene.given_planes is None else scene.given_planes
    model = build_model(scene.points, scene.outline, plane_id=number, ground_elevation=scene.ground_elevation)
    return model, planes.plane_id


def drawn(model: BuildingModel, level: str, *points: Coloured) -> np.ndarray:
    """Draw one level of detail of a model, and points before it."""
    only = replace(model, solids={level: model.solids[level]})
    line = feature_line(only, 1, MapFrame(), {}, anchor=(0.0, 0.0))
    arrays = model_arrays([line], [load_feature(line)[0]["id"]], 10**6)
    return picture_of([*models_of(arrays, [""], "slope"), *points], "southwest", SIZE)


def dots(points: np.ndarray, colours: np.ndarray) -> Coloured:
    """Return points that stand before the roof that they lie on."""
    return Coloured((points + LIFT)[:, None], colours)


def roofs_picture() -> np.ndarray:
    """Draw the finest model of every roof."""
    tiles = []
    for name in ROOFS:
        model, _ = modelled(model_scene(name, density=DENSITY, rotation_deg=ROTATION_DEG))
        level = max(model.solids)
        note = "" if level == LEVELS[-1] else f" (LoD{level})"
        tiles.append(titled(drawn(model, level), name.replace("_", " ") + note))
    return grid(tiles, PER_ROW)


def levels_picture() -> np.ndarray:
    """
    Draw points by plane and the three levels of detail of three buildings, a missing level as an empty place.
    """
    rows = []
    for name in ("gable_dormer", "church", "step"):
        scene = model_scene(name, density=DENSITY, rotation_deg=ROTATION_DEG)
        model, number = modelled(scene)
        colours = np.where(number[:, None] > 0, PLANES[(number - 1) % len(PLANES)], NO_PLANE)
        by_plane = drawn(model, max(model.solids), dots(scene.points, colours))
        rows.append(titled(by_plane, "points by plane"))
        rows += [
            titled(drawn(model, level), f"LoD{level}") if level in model.solids else NOTHING
            for level in LEVELS
        ]
    return grid(rows, 1 + len(LEVELS))


def bad_picture() -> np.ndarray:
    """Draw what comes of hard and bad input, with the points that there were."""
    tiles = []
    for name, make in BAD_SCENES.items():
        scene = make(density=DENSITY, rotation_deg=ROTATION_DEG)
        model, _ = modelled(scene)
        level = max(model.solids)
        picture = drawn(model, level, dots(scene.points, np.tile(PLANES[0], (len(scene.points), 1))))
        tiles.append(titled(picture, f"{name.replace('_', ' ')}: LoD{level}"))
    return grid(tiles, 4)


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
