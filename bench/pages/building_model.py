"""Draw the picture of the page on building models, from the virtual houses of the tests."""

import sys
from pathlib import Path

import numpy as np
import shapely
from matplotlib.colors import to_rgb
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from bench.pages.drawing import plt, save
from bench.scenes import buildings as scenes
from lidar_buildings.core.solids.output_grid import GRID, gridded_outline
from lidar_buildings.core.solids.shell import ROOF_SURFACE, WALL_SURFACE
from lidar_buildings.core.solids.triangulation import face_pieces
from lidar_buildings.core.stages.building_model.cells import cut_into_cells, extend_segments
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.core.stages.roof_topology.topology import find_topology

POINTS, LINES, ROOF, WALL = "#b4bac4", "#c8472f", "#c8705a", "#d8dbe0"


def main(picture: Path) -> None:
    """Draw lines, cells and solids of an L-shaped house, and houses with half a roof and with a dormer."""
    figure = plt.figure(figsize=(13.0, 8.4), dpi=80, layout="constrained")
    house = scenes.l_shape(rotation_deg=20.0)
    points, outline = house.roof_points(), gridded_outline(house.buildings[0].outline)
    plane_id = fit_roof_planes(points).plane_id
    draw_lines(figure.add_subplot(2, 3, 1), points, plane_id, outline)
    for place, lod in ((2, "1.2"), (3, "2.2")):
        draw_solid(
            figure.add_subplot(2, 3, place, projection="3d"), points, plane_id, outline, lod, f"LoD{lod}"
        )
    gable = scenes.gable(rotation_deg=20.0)
    half = gable.roof_points()
    half = half[half[:, 0] < half[:, 0].mean()]
    draw_house(figure.add_subplot(2, 3, 4, projection="3d"), half, gable, "half of the points missing")
    for place, name in ((5, "dormer"), (6, "courtyard")):
        scene = scenes.GALLERY[name](rotation_deg=20.0)
        draw_house(figure.add_subplot(2, 3, place, projection="3d"), scene.roof_points(), scene, name)
    save(figure, picture)


def draw_lines(axes, points, plane_id, outline):
    """Draw ridges and valleys as they were found (bold) and the cells that they cut the outline into."""
    topology = find_topology(points, plane_id, outline)
    found = np.array([one.segment[:, :2] for one in topology.intersections])
    found = np.concatenate([found, np.array([one.segment for one in topology.steps]).reshape(-1, 2, 2)])
    ring = outline.exterior
    walls = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
    cells = cut_into_cells(outline, extend_segments(found, walls))
    axes.scatter(*points[:, :2].T, s=2.0, color=POINTS)
    for polygon in cells.polygons:
        axes.plot(*(GRID * shapely.get_coordinates(polygon.exterior)).T, color="black", linewidth=0.7)
    for segment in found:
        axes.plot(*segment.T, color=LINES, linewidth=2.4)
    axes.set_title("lines found (red), run on to cut cells", fontsize=10)
    axes.set_aspect("equal")
    axes.axis("off")


def draw_house(axes, points, scene, title):
    """Fit planes and draw the finest solid."""
    plane_id = fit_roof_planes(points).plane_id
    draw_solid(axes, points, plane_id, scene.buildings[0].outline, "2.2", title)


def shaded(colour, ring):
    """Return a colour as it looks on a face that the light falls on from the south-west."""
    offsets = ring - ring[0]
    normal = np.cross(offsets, np.roll(offsets, -1, axis=0)).sum(axis=0)
    light = normal @ [-0.6, -0.35, 0.72] / np.linalg.norm(normal)
    return tuple(np.array(to_rgb(colour)) * (0.72 + 0.28 * light))


def draw_solid(axes, points, plane_id, outline, lod, title):
    """Draw one solid with the points on its roof."""
    solid = build_model(points, outline, plane_id=plane_id, ground_elevation=scenes.GROUND).solids[lod]
    # Drawn by the distance of whole polygons: roofs come in triangles.
    polygons, colours = [], []
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        rings = solid.face_rings(face)
        if kind == ROOF_SURFACE:
            pieces = [solid.vertices[list(rows)] for rows in face_pieces(solid.vertices, [face])[0]]
            polygons += pieces
            colours += [shaded(ROOF, rings[0])] * len(pieces)
        elif kind == WALL_SURFACE:
            polygons.append(rings[0])
            colours.append(shaded(WALL, rings[0]))
    axes.add_collection3d(
        Poly3DCollection(polygons, facecolor=colours, edgecolor=colours, linewidth=0.4, zsort="average")
    )
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low)
    axes.view_init(elev=38.0, azim=-120.0)
    axes.set_title(title, fontsize=10)
    axes.axis("off")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
