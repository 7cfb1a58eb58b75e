"""Draw the picture of the page on solids and their validity, from synthetic roofs."""

import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from bench.pages.drawing import plt, save
from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.raising import roof_solid
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from lidar_buildings.core.solids.triangulation import face_arrays, fitted_planes, triangulate
from lidar_buildings.core.solids.validity import check_solid

COLOURS = {ROOF_SURFACE: "#c8472f", WALL_SURFACE: "#d9dde3", GROUND_SURFACE: "#7f6a4f"}
#: Light from the south-west, from above.
LIGHT = np.array([-0.4, -0.6, 0.7]) / np.linalg.norm([-0.4, -0.6, 0.7])


def main(picture: Path) -> None:
    """
    Draw a roof in pieces, walls with all elevations of their vertices, a crossing, touching walls, and folds.
    """
    figure = plt.figure(figsize=(13.0, 8.4), dpi=80, layout="constrained")
    draw(figure.add_subplot(231, projection="3d"), town_house(), "a roof in four pieces, a courtyard")
    columns = figure.add_subplot(232, projection="3d")
    draw(columns, steps(), "walls contain all elevations of their vertices", alpha=0.35, vertices=True)
    draw(figure.add_subplot(233, projection="3d"), crossing(), "where profiles cross, the edge is divided")
    draw(
        figure.add_subplot(234, projection="3d"),
        checkers(),
        "high and low in turns: one valley is drawn back",
    )
    draw_plan(figure.add_subplot(235), checkers(), "the same in plan, near the vertex", (4.97, 5.03))
    draw_triangles(figure.add_subplot(236), town_house())
    save(figure, picture, 64)


def rectangle(left, low, right, high):
    """Return a rectangle's ring."""
    return np.array([[left, low], [right, low], [right, high], [left, high]], dtype=float)


def town_house():
    """A gable with a tower on its ridge, a lower wing with a courtyard."""
    tower, yard = rectangle(4, 2.5, 6, 5.5), rectangle(13, 3, 15, 5)
    south = np.array([[0, 0], [10, 0], [10, 4], [6, 4], [6, 2.5], [4, 2.5], [4, 4], [0, 4]], dtype=float)
    north = np.array([[0, 4], [4, 4], [4, 5.5], [6, 5.5], [6, 4], [10, 4], [10, 8], [0, 8]], dtype=float)
    wing = np.array([[10, 0], [18, 0], [18, 8], [10, 8], [10, 4]], dtype=float)
    return [
        RoofPiece((south,), (0.0, 0.7, 4.0)),
        RoofPiece((north,), (0.0, -0.7, 9.6)),
        RoofPiece((tower,), (0.0, 0.0, 11.0)),
        RoofPiece((wing, yard[::-1]), (-0.15, 0.0, 5.2)),
    ]


def steps():
    """Three flat pieces that meet in one vertex."""
    heights = {(0, 0, 8, 5): 3.0, (0, 5, 4, 9): 8.0, (4, 5, 8, 9): 5.5}
    return [RoofPiece((rectangle(*box),), (0.0, 0.0, z)) for box, z in heights.items()]


def crossing():
    """Two sheds that slope against each other."""
    return [
        RoofPiece((rectangle(0, 0, 10, 4),), (0.5, 0.0, 2.0)),
        RoofPiece((rectangle(0, 4, 10, 8),), (-0.5, 0.0, 7.0)),
    ]


def checkers():
    """Four flat pieces, high and low in turns."""
    heights = {(0, 0): 3.0, (5, 0): 8.0, (5, 5): 4.0, (0, 5): 7.0}
    return [RoofPiece((rectangle(x, y, x + 5, y + 5),), (0.0, 0.0, z)) for (x, y), z in heights.items()]


def draw(axes, pieces, title, alpha=1.0, vertices=False) -> None:
    """Draw a solid, triangle by triangle, so that faces with holes show them, and the edges of its faces."""
    solid = roof_solid(pieces, 0.0)
    arrays = face_arrays(solid)
    triangles, face_of = triangulate(arrays, fitted_planes(arrays)[1])
    corners = solid.vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    shade = 0.72 + 0.28 * (normals @ LIGHT) / np.linalg.norm(normals, axis=1)
    base = np.array([to_rgb(COLOURS[solid.semantics[k]]) for k in face_of])
    axes.add_collection3d(
        Poly3DCollection(corners, facecolors=np.clip(base * shade[:, None], 0, 1), alpha=alpha)
    )
    for ring in (ring for face in solid.faces for ring in solid.face_rings(face)):
        axes.plot(*np.vstack([ring, ring[:1]]).T, color="#333333", linewidth=0.6, zorder=5)
    if vertices:
        axes.plot(*solid.vertices.T, "o", color="#1f4e8c", markersize=4, zorder=6)
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low)
    axes.view_init(30, -60)
    axes.set_axis_off()
    axes.set_title(f"{title}\n{len(solid.faces)} faces, codes {list(check_solid(solid))}", fontsize=9)


def draw_plan(axes, pieces, title, limits) -> None:
    """Draw the roof faces of a solid in plan, within limits."""
    solid = roof_solid(pieces, 0.0)
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        if kind == ROOF_SURFACE:
            ring = solid.vertices[list(face[0])]
            axes.fill(*ring[:, :2].T, alpha=0.35, label=f"{ring[0, 2]:.0f} m")
            axes.plot(
                *np.vstack([ring, ring[:1]])[:, :2].T, "o-", color="#333333", linewidth=1.0, markersize=4
            )
    axes.legend(loc="upper right", fontsize=8)
    axes.set(xlim=limits, ylim=limits, aspect="equal")
    axes.tick_params(labelsize=7)
    axes.set_title(title, fontsize=9)


def draw_triangles(axes, pieces) -> None:
    """Draw the triangles in which the ground face and the roof faces are checked."""
    solid = roof_solid(pieces, 0.0)
    arrays = face_arrays(solid)
    triangles, face_of = triangulate(arrays, fitted_planes(arrays)[1])
    for number, kind in enumerate(solid.semantics):
        if kind == ROOF_SURFACE:
            axes.triplot(*solid.vertices[:, :2].T, triangles[face_of == number], linewidth=1.0)
    axes.set(aspect="equal")
    axes.axis("off")
    axes.set_title("the triangles by which folds and intersections are found", fontsize=9)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
