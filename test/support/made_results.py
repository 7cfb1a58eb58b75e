"""Results of tiles, made up, and output folders of them."""

import numpy as np

from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.io.models.cityjson import feature_line
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.tile_products import TileProducts


def products_of(tile):
    """Make results up that depend on nothing but the points: those above 10 m are one house's roof."""
    high = tile.points[:, 2] > 10.0
    classified = tile.with_columns(
        classification=np.where(high, 6, 2), height_above_ground=tile.points[:, 2] - 1.0
    )
    roofs = classified.select(high)
    number = 1 + len(tile.points) % 1000
    own = np.where(roofs.points[:, 0] < np.median(roofs.points[:, 0]), number, 0)
    planes = roofs.with_columns(edge=roofs.index % 2, building_id=own, plane_id=np.where(own > 0, 3, 0))
    west, south = (float(c) for c in tile.points[:, :2].min(axis=0))
    ring = np.array([[west, south], [west + 8.0, south], [west + 8.0, south + 6.0], [west, south + 6.0]])
    hole = np.array([[west + 2.0, south + 2.0], [west + 2.0, south + 4.0], [west + 4.0, south + 2.0]])
    one = BuildingOutline(number, Outline(ring, (hole,)))
    model = BuildingModel({}, {"height": 8.5}, BuildingStatus.NO_SOLID, "made up")
    line = feature_line(model, number, tile.frame, model.attributes, anchor=(west, south))
    return TileProducts.from_tiles(classified, planes, [one], [one], [line])


def bytes_of(folder):
    """Return the content of each file by its name; `lines` is a builder's own."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "lines"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def run(folder, source, tiles, **options):
    output = OutputFolder(folder, source.inputs, source.frame, **options)
    for tile in tiles:
        output.write_tile(products_of(tile))
    return output.finalise({"versions": {"lidar_buildings": "0"}})
