"""
What merging takes by the number of tiles: one tile of a house and its file, laid out again and again.

    python -m bench.scale.merging [--tiles 100 200 400 800]

Printed are processor seconds and the largest memory so far. All is done in one process.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from lidar_buildings.commands.tile_work import products_of
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.io.clouds.las import frame_of, open_inputs, read_tile
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.pipeline.tile_stages import rasterise_tile
from lidar_buildings.simulation import simulate_survey

#: From house to house [m]; whole cells of the rasters.
STEP = 100.0
#: Coordinates of the city model are whole numbers of these [m].
_UNIT = 0.001


def main() -> None:
    """Print what merging takes for each number of tiles."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--tiles", type=int, nargs="+", default=[100, 200, 400, 800])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="merging_") as name:
        folder = Path(name)
        simulate_survey(folder / "house", "single_house", 0, density=3.0)
        (cloud,), _ = open_inputs(folder / "house")
        frame = frame_of([cloud])
        tile = replace(read_tile(cloud.path), frame=frame)
        result = reconstruct_tile(tile, PipelineConfig())
        products = products_of(result, frame, rasterise_tile(result.classified, RasterConfig(), frame))
        merge(folder / "first", [cloud.input_file], frame, [products])  # loads what is needed
        for n_tiles in options.tiles:
            side = int(np.ceil(np.sqrt(n_tiles)))
            tiles = (moved(products, number, *divmod(number, side)) for number in range(n_tiles))
            seconds = merge(folder / f"of_{n_tiles}", [cloud.input_file] * n_tiles, frame, tiles)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
            each = 1000 * seconds / n_tiles
            print(f"{n_tiles} tiles: {seconds:.1f} processor s, {each:.1f} ms a tile, {memory / 1e6:.0f} MB")


def merge(path: Path, inputs, frame, tiles) -> float:
    """Save tiles, and return what making the files of them takes [s]."""
    output = OutputFolder(path, inputs, frame)
    for products in tiles:
        output.write_tile(products)
    before = time.process_time()
    output.finalise()
    return time.process_time() - before


def moved(products: TileProducts, number: int, column: int, row: int) -> TileProducts:
    """Return the tile at another place, of another file."""
    shift = np.array([column, row]) * STEP
    tables = {}
    for name in ("core", "roofs", "edges"):
        tables[name] = getattr(products, name).copy()
        tables[name]["source"] = number
    tables["roofs"]["building_id"] += np.uint32(number)
    window, cells = products.rasters.window, np.round(shift / products.rasters.window.resolution).astype(int)
    place = replace(window, column=window.column + int(cells[0]), row=window.row - int(cells[1]))
    return TileProducts(
        products.stamp + 1_000_000 * number,
        **tables,
        traced=tuple(_moved_outline(one, number, shift) for one in products.traced),
        outlines=tuple(_moved_outline(one, number, shift) for one in products.outlines),
        features=tuple(_moved_feature(line, number, shift) for line in products.features),
        rasters=replace(products.rasters, window=place),
    )


def _moved_outline(one: BuildingOutline, number: int, shift: np.ndarray) -> BuildingOutline:
    rings = [ring + shift for ring in one.outline.rings]
    return replace(one, building_id=one.building_id + number, outline=Outline(rings[0], tuple(rings[1:])))


def _moved_feature(line: str, number: int, shift: np.ndarray) -> str:
    """Return a building of the city model at another place, under another id."""
    feature = json.loads(line)
    before = feature["id"]
    x, y = (float(word) for word in before.split("-")[1:])
    steps = (np.array([*shift, 0.0]) / _UNIT).astype(int)
    feature["vertices"] = (np.array(feature["vertices"]) + steps).tolist()
    for city_object in feature["CityObjects"].values():
        if "building_id" in city_object.get("attributes", {}):
            city_object["attributes"]["building_id"] += number
    text = json.dumps(feature, separators=(",", ":"))
    return text.replace(before, f"building-{x + shift[0]:.1f}-{y + shift[1]:.1f}")


if __name__ == "__main__":
    main()
