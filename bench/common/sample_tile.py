"""
Write the tile on which `lidar-buildings warm-up` compiles every stage: a hamlet with what the stages know.

    python -m bench.common.sample_tile

Its columns are those of the whole chain, so that each stage can be called without those before it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.commands.stage_calls import SAMPLE
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.simulation import roof_shapes as shapes
from lidar_buildings.simulation import simulate_tile
from lidar_buildings.simulation.scene import Road, Site, Terrain, VirtualScene, Wave

#: Seed of the scene and its density [1/m²].
SEED, DENSITY = 0, 3.0
#: Column → decimals that are kept, so that the file is small.
DECIMALS = {
    **{"gps_time": 5, "scan_angle": 0, "point_source_id": 0, "return_number": 0, "number_of_returns": 0},
    **{"intensity": -3, "classification": 0, "facade": 0, "height_above_ground": 1, "building_id": 0},
    "plane_id": 0,
}


def hamlet(seed: int) -> VirtualScene:
    """Return a row of houses, a courtyard, a tower and a church among trees, 90 m square."""
    site = Site((90.0, 90.0), Terrain(50.0, (0.02, 0.01), (Wave(0.5, 60.0, 30.0),)), seed)
    site.roads.append(Road((0.0, 45.0), (90.0, 45.0), 6.0))
    site.add_row([shapes.gable(length=9), shapes.flat(length=9), shapes.dormer(length=10)], 22, 22, 10)
    site.add_building(shapes.courtyard(24, 22, 8), 66, 22, 20)
    site.add_building(shapes.church(), 20, 68, 30)
    site.add_building(shapes.round_tower(), 48, 72)
    site.add_building(shapes.l_shape(), 70, 68, 35)
    site.add_cars(3)
    site.add_trees(6, clearance=1.0)
    return site.scene("hamlet")


def main() -> None:
    """Run the chain on the hamlet and keep what it gave."""
    tile, _ = simulate_tile(hamlet(SEED), SEED, density=DENSITY)
    tile = tile.with_columns(points=np.round(tile.points, 2))
    tile = tile.with_columns(point_spacing=measure_spacing(tile.points))
    result = reconstruct_tile(tile)
    rows = np.flatnonzero(result.classified.is_roof)
    columns = dict(result.classified.columns)
    for name in ("building_id", "plane_id"):
        column = getattr(result.roofs, name)
        columns[name] = np.zeros(len(tile), dtype=column.dtype)
        columns[name][rows] = column
    np.savez_compressed(
        SAMPLE,
        points=result.classified.points.astype(np.float32),
        point_spacing=tile.point_spacing,
        traced_rings=stored_rings(result.traced),
        outlines_rings=stored_rings(result.outlines),
        **{name: np.round(columns[name], decimals) for name, decimals in DECIMALS.items()},
    )
    print(f"{len(tile)} points, {len(result.models)} buildings, {SAMPLE.stat().st_size / 1e3:.0f} kB")


def stored_rings(outlines: Sequence[BuildingOutline]) -> NDArray[np.float64]:
    """Return all vertices as rows of building, ring (0: the outer one), x and y."""
    return np.array(
        [
            (one.building_id, number, *vertex)
            for one in outlines
            for number, ring in enumerate(one.outline.rings)
            for vertex in ring
        ]
    )


if __name__ == "__main__":
    main()
