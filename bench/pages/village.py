"""
Draw the picture of the README: a result seen from above, and its building models in 3D.

It needs matplotlib (``pip install matplotlib``) beside the package:

    lidar-buildings simulate --output survey
    lidar-buildings run survey --output result
    python -m bench.pages.village result doc/village.png
"""

import json
import sys
from pathlib import Path

import laspy
import mapbox_earcut
import matplotlib
import numpy as np
import pyogrio
import shapely

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image
from scipy.interpolate import griddata

#: West, south, east, north of the part that is drawn, from the survey's lower left corner [m].
WINDOW = (50.0, 54.0, 214.0, 214.0)
#: ASPRS class → (what it is, colour), in the order of the legend.
CLASSES = {
    2: ("ground", "#d9cdb4"),
    4: ("medium vegetation", "#b5c95a"),
    5: ("high vegetation", "#4f8a47"),
    6: ("building", "#d9705a"),
    11: ("road", "#8f8578"),
    1: ("unclassified", "#6f7f9a"),
}
OUTLINE = "#1b1f3a"
ROOF, WALL, TERRAIN = "#d9705a", "#efe9df", "#dcd6c4"
#: Where the light comes from, and how bright a face in the shade is.
LIGHT, SHADE = np.array([-0.45, -0.65, 0.6]), 0.55
#: Side of the cells of the terrain in the 3D view [m], and of a point seen from above [pt²].
TERRAIN_CELL, POINT_SIZE = 5.0, 1.2


def main(result: Path, picture: Path) -> None:
    """Draw one result folder of ``lidar-buildings run`` into one PNG."""
    points, classes = read_points(result / "classified")
    origin = points.min(axis=0)
    points = points - origin
    inside = is_inside(points[:, :2])
    figure = plt.figure(figsize=(12.4, 5.6), dpi=100)
    plan = figure.add_axes((0.0, 0.01, 0.45, 0.98))
    draw_plan(plan, points[inside], classes[inside], read_outlines(result, origin))
    view = figure.add_axes((0.425, -0.2, 0.6, 1.36), projection="3d", computed_zorder=False)
    draw_models(view, terrain(points[np.isin(classes, (2, 11))]), read_faces(result, origin))
    figure.savefig(picture)
    Image.open(picture).convert("RGB").save(picture, optimize=True)


def is_inside(xy: np.ndarray) -> np.ndarray:
    """Tell which rows lie in the part that is drawn."""
    west, south, east, north = WINDOW
    return ((xy >= (west, south)) & (xy <= (east, north))).all(axis=1)


def read_points(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return all points and their classes."""
    clouds = [laspy.read(path) for path in sorted(folder.glob("*.laz"))]
    return (
        np.vstack([np.asarray(cloud.xyz) for cloud in clouds]),
        np.concatenate([np.asarray(cloud.classification) for cloud in clouds]),
    )


def read_outlines(result: Path, origin: np.ndarray) -> list[np.ndarray]:
    """Return the rings of the regularised outlines, in plan."""
    polygons = shapely.from_wkb(pyogrio.raw.read(result / "buildings.gpkg", layer="outlines", columns=[])[2])
    return [
        shapely.get_coordinates(ring) - origin[:2]
        for polygon in polygons
        for ring in shapely.get_rings(polygon)
    ]


def read_faces(result: Path, origin: np.ndarray) -> list[tuple[str, list[np.ndarray]]]:
    """
    Return (kind of surface, its rings) of every face but those on the ground, of the buildings in the window.
    """
    lines = (result / "city_model.city.jsonl").read_text(encoding="utf-8").splitlines()
    header, *features = map(json.loads, lines)
    scale, shift = (np.array(header["transform"][key]) for key in ("scale", "translate"))
    faces = []
    for feature in features:
        vertices = np.array(feature["vertices"]) * scale + shift - origin
        if not is_inside(vertices[:, :2]).all():
            continue
        for part in feature["CityObjects"].values():
            if not part["geometry"]:
                continue
            solid = max(part["geometry"], key=lambda one: one["lod"])
            kinds = [surface["type"] for surface in solid["semantics"]["surfaces"]]
            for face, kind in zip(solid["boundaries"][0], solid["semantics"]["values"][0], strict=True):
                if kinds[kind] != "GroundSurface":
                    faces.append((kinds[kind], [vertices[ring] for ring in face]))
    return faces


def terrain(ground: np.ndarray) -> list[np.ndarray]:
    """Return the ground as quadrilaterals between its heights at the corners of cells."""
    west, south, east, north = WINDOW
    x, y = np.arange(west, east + 0.1, TERRAIN_CELL), np.arange(south, north + 0.1, TERRAIN_CELL)
    sample = ground[:: max(len(ground) // 50_000, 1)]
    z = griddata(sample[:, :2], sample[:, 2], tuple(np.meshgrid(x, y, indexing="ij")))
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    return [
        np.array([(x[i + di], y[j + dj], z[i + di, j + dj]) for di, dj in corners])
        for i in range(len(x) - 1)
        for j in range(len(y) - 1)
    ]


def draw_plan(axes: plt.Axes, points: np.ndarray, classes: np.ndarray, rings: list[np.ndarray]) -> None:
    """Draw points by class from above, outlines over them."""
    order = np.argsort(points[:, 2], kind="stable")
    order = order[np.isin(classes[order], list(CLASSES))]
    colours = np.zeros((256, 3))
    for code, (_, colour) in CLASSES.items():
        colours[code] = matplotlib.colors.to_rgb(colour)
    axes.scatter(*points[order, :2].T, s=POINT_SIZE, c=colours[classes[order]], linewidths=0, marker="s")
    for ring in rings:
        axes.plot(*ring.T, color=OUTLINE, linewidth=1.5, solid_joinstyle="miter")
    west, south, east, north = WINDOW
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    axes.set_axis_off()
    marks = [Line2D([], [], color=c, marker="s", linestyle="", label=name) for name, c in CLASSES.values()]
    marks.append(Line2D([], [], color=OUTLINE, label="regularised outline"))
    axes.legend(handles=marks, loc="lower left", fontsize=7.5, framealpha=0.92, borderaxespad=0.2)


def draw_models(axes: plt.Axes, ground: list[np.ndarray], faces: list[tuple[str, list[np.ndarray]]]) -> None:
    """Draw the models on the terrain, seen from the south."""
    below = [shaded(TERRAIN, quad) for quad in ground]
    axes.add_collection3d(Poly3DCollection(ground, facecolors=below, edgecolors=below, zorder=0))
    parts, colours = [], []
    for kind, rings in faces:
        triangles = triangulated(rings)
        parts += triangles
        colours += [shaded(ROOF if kind == "RoofSurface" else WALL, rings[0])] * len(triangles)
    axes.add_collection3d(
        Poly3DCollection(parts, facecolors=colours, edgecolors=colours, linewidths=0.3, zorder=1)
    )
    corners = np.vstack(parts + ground)
    low, high = corners.min(axis=0), corners.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.patch.set_visible(False)
    axes.set_box_aspect(high - low, zoom=1.13)
    axes.view_init(elev=40, azim=-76)
    axes.set_axis_off()


def triangulated(rings: list[np.ndarray]) -> list[np.ndarray]:
    """Cut a plane face with holes into triangles."""
    vertices = np.vstack(rings)
    flat = np.abs(normal(rings[0] - rings[0][0])).argmax()
    plan = np.ascontiguousarray(np.delete(vertices, flat, axis=1))
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    return list(vertices[mapbox_earcut.triangulate_float64(plan, ends)].reshape(-1, 3, 3))


def normal(ring: np.ndarray) -> np.ndarray:
    """Return a face's normal by Newell's sum."""
    return np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0)


def shaded(colour: str, ring: np.ndarray) -> tuple[float, ...]:
    """Darken a colour by the angle between a face and the light."""
    across = normal(ring - ring[0])
    lit = abs(across @ LIGHT) / max(np.linalg.norm(across) * np.linalg.norm(LIGHT), 1e-12)
    return tuple(np.array(matplotlib.colors.to_rgb(colour)) * (SHADE + (1 - SHADE) * lit))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python -m bench.pages.village RESULT PICTURE.png")
    main(Path(sys.argv[1]), Path(sys.argv[2]))
