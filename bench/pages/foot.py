"""Draw the picture of feet on level ground and on the terrain: a hillside block, simulated and built."""

import sys
from pathlib import Path

import numpy as np
import shapely
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from bench.pages.building_model import ROOF, WALL, shaded
from bench.pages.drawing import plt, save
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE
from lidar_buildings.core.solids.triangulation import face_pieces
from lidar_buildings.core.stages.building_model.config import DRAPED, LEVEL, BuildingModelConfig
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.pipeline.tile_models import build_models
from lidar_buildings.simulation import roof_shapes
from lidar_buildings.simulation.scene import Site, Terrain, Wave
from lidar_buildings.simulation.survey import simulate_tile

TERRAIN = "#2f7d46"


def main(picture: Path) -> None:
    """Draw the block on level feet, then on the terrain."""
    site = Site((70.0, 50.0), Terrain(100.0, (0.22, 0.1), (Wave(0.5, 24.0, 20.0),)), 3)
    site.add_row([roof_shapes.gable(9, 10, eave, 38) for eave in (5.0, 6.2, 8.0)], 24.0, 26.0, 12.0)
    site.add_building(roof_shapes.l_shape(16), 54.0, 24.0, 160.0)
    tile, truth = simulate_tile(site.scene("block"), 3, density=8.0)
    found = reconstruct_tile(tile, until="plane_fitting")
    figure = plt.figure(figsize=(13.0, 2.8), dpi=80)
    for place, foot in enumerate((LEVEL, DRAPED)):
        models = build_models(found.roofs, found.outlines, BuildingModelConfig(foot=foot))
        axes = figure.add_axes((0.5 * place, -0.75, 0.5, 2.5), projection="3d")
        draw_block(axes, [one.model.solids["2.2"] for one in models], truth.scene.terrain)
        figure.text(0.5 * place + 0.02, 0.93, f"foot: {foot}", fontsize=11)
    save(figure, picture)


def draw_block(axes, solids, terrain):
    """Draw solids as seen from down the hill, and the true terrain along their walls and behind them."""
    polygons, colours, lines = [], [], []
    for solid in solids:
        for face, kind in zip(solid.faces, solid.semantics, strict=True):
            rings = solid.face_rings(face)
            if kind == GROUND_SURFACE:
                plan = shapely.segmentize(shapely.linearrings(rings[0][:, :2]), 0.5)
                border = shapely.get_coordinates(plan)
                lines.append(np.column_stack([border, terrain.at(border)]))
                continue
            pieces = [solid.vertices[list(rows)] for rows in face_pieces(solid.vertices, [face])[0]]
            polygons += pieces
            colours += [shaded(ROOF if kind == ROOF_SURFACE else WALL, rings[0])] * len(pieces)
    axes.add_collection3d(
        Poly3DCollection(
            polygons, facecolor=colours, edgecolor=colours, linewidth=0.4, zsort="average", clip_on=False
        )
    )
    axes.computed_zorder = False  # the terrain shows through walls
    axes.add_collection3d(Line3DCollection(lines, colors=TERRAIN, linewidths=1.6, zorder=9, clip_on=False))
    every = np.concatenate([solid.vertices for solid in solids])
    low, high = every.min(axis=0) - 1.0, every.max(axis=0) + 1.0
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=0.95)
    axes.view_init(elev=14.0, azim=-78.0)
    axes.axis("off")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
