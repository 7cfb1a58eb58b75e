"""
How the time grows with what there is of each kind: each is doubled, and the exponent is fitted.

    python -m bench.scale.growth [KIND ...]

Printed are processor seconds for each number, and the exponent of the last doublings. Above 1.2 a kind grows
faster than it should. Those of one building end where it does: vertices of a model's outline are limited to
1,000, of footprints that cannot be simplified to 5,000 (see `core/stages/footprints`).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import laspy
import numpy as np
import shapely

from bench.scale.merging import merge, moved
from bench.scans.run import scan_of, transform_of
from lidar_buildings.commands.inspect import summarise_cloud
from lidar_buildings.commands.tile_work import products_of
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.scans.placing import ScanPlacer
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.footprints.footprints import footprints_of, repaired_polygons
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.io.bags.bag_summary import summarise_bag
from lidar_buildings.io.clouds.las import frame_of, open_inputs, read_tile
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.pipeline.tile_stages import rasterise_tile
from lidar_buildings.simulation import simulate_survey

#: An exponent that is as good as linear.
LINEAR = 1.2
#: Calls something of a size; what it returns is timed.
Prepare = Callable[[Path, int], Callable[[], object]]


def vertices(_: Path, n: int) -> Callable[[], object]:
    """Return the reading of a footprint whose walls are drawn with noise."""
    random, angle = np.random.default_rng(0), np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    radius = 12.0 + random.normal(0.0, 0.02, n)
    shape = shapely.Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    return lambda: footprints_of(repaired_polygons(np.array([shape])).polygons)


def holes(_: Path, n: int) -> Callable[[], object]:
    """Return the reading of a footprint with so many courtyards: beyond the limit it is left out."""
    side = int(np.ceil(np.sqrt(n)))
    column, row = np.divmod(np.arange(n), side)
    courts = shapely.box(3.0 * column + 1.0, 3.0 * row + 1.0, 3.0 * column + 2.0, 3.0 * row + 2.0)
    shape = shapely.Polygon(
        shapely.box(0.0, 0.0, 3.0 * side, 3.0 * side).exterior, [c.exterior for c in courts]
    )
    return lambda: repaired_polygons(np.array([shape]))


def crossings(_: Path, n: int) -> Callable[[], object]:
    """Return the reading of a scribble of so many walls: beyond the limit of crossings it is left out."""
    shape = shapely.Polygon(np.random.default_rng(0).uniform(0.0, 50.0, (n, 2)))
    return lambda: repaired_polygons(np.array([shape]))


def footprints(_: Path, n: int) -> Callable[[], object]:
    """Return the reading of so many footprints side by side."""
    column, row = np.divmod(np.arange(n), int(np.ceil(np.sqrt(n))))
    shapes = shapely.box(20.0 * column, 20.0 * row, 20.0 * column + 12.0, 20.0 * row + 9.0)
    return lambda: footprints_of(repaired_polygons(shapes).polygons)


def copies(_: Path, n: int) -> Callable[[], object]:
    """Return the reading of one footprint that was drawn so many times, a few centimetres off."""
    west, south, east, north = np.random.default_rng(0).uniform(-0.03, 0.03, (4, n))
    shapes = shapely.box(west, south, 12.0 + east, 9.0 + north)
    return lambda: footprints_of(repaired_polygons(shapes).polygons)


def buildings(_: Path, n: int) -> Callable[[], object]:
    """Return the reconstruction of a tile with so many houses."""
    side = int(np.ceil(np.sqrt(n)))
    area = np.array([20.0 * side, 20.0 * np.ceil(n / side)])
    points = np.random.default_rng(0).uniform(0.0, 1.0, (int(4.0 * area.prod()), 3)) * [*area, 0.0]
    in_cell = points[:, :2] % 20.0
    number = points[:, :2] // 20.0 @ [1.0, side]
    is_roof = ((in_cell > 5.0) & (in_cell < 15.0)).all(axis=1) & (number < n)
    points[is_roof, 2] = 7.0 - 0.5 * np.abs(in_cell[is_roof, 0] - 10.0)
    tile = PointTile(points)
    return lambda: reconstruct_tile(tile, PipelineConfig())


def outlines(_: Path, n: int) -> Callable[[], object]:
    """Return the model of a round flat roof whose outline has so many vertices."""
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    ring = 15.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.random.default_rng(0).uniform(-15.0, 15.0, (4000, 3))
    points = points[np.hypot(*points[:, :2].T) < 15.0]
    points[:, 2] = 6.0
    planes = np.ones(len(points), dtype=np.uint16)
    return lambda: build_model(points, Outline(ring), plane_id=planes, ground_elevation=0.0)


def faces(_: Path, n: int) -> Callable[[], object]:
    """Return the model of a saw-tooth roof of so many faces."""
    random, width = np.random.default_rng(0), 3.0
    points = random.uniform(0.0, 1.0, (int(n * width * 10.0 * 4.0), 3)) * [n * width, 10.0, 0.0]
    tooth = (points[:, 0] // width).astype(np.uint16)
    points[:, 2] = 5.0 + 0.5 * (points[:, 0] - width * tooth)
    ring = np.array([[0.0, 0.0], [n * width, 0.0], [n * width, 10.0], [0.0, 10.0]])
    return lambda: build_model(points, Outline(ring), plane_id=tooth + 1, ground_elevation=0.0)


def _cloud(path: Path, n_points: int, side: float, corner: tuple[float, float] = (0.0, 0.0)) -> laspy.LasData:
    random = np.random.default_rng(len(path.name))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.zeros(3)
    cloud = laspy.LasData(header)
    cloud.xyz = random.uniform(0.0, 1.0, (n_points, 3)) * [side, side, 3.0] + [*corner, 0.0]
    cloud.gps_time = np.arange(n_points) * 1e-4 + 1e8
    cloud.return_number[:], cloud.number_of_returns[:] = 1, 1
    cloud.intensity = random.integers(0, 1000, n_points)
    return cloud


def _tiles_of(inputs: Path) -> int:
    with TileSource([inputs], TilingConfig()) as source:
        return sum(len(tile.read()) for tile in source.ready())


def files(folder: Path, n: int) -> Callable[[], object]:
    """Return the cutting into tiles of so many small files."""
    side = int(np.ceil(np.sqrt(n)))
    for number in range(n):
        corner = 100.0 * (number % side), 100.0 * (number // side)
        path = folder / f"{number}.las"
        _cloud(path, 200, 100.0, corner).write(path)
    return lambda: _tiles_of(folder)


def tiles(folder: Path, n: int) -> Callable[[], object]:
    """Return the files made of so many tiles, each with a house."""
    simulate_survey(folder / "house", "single_house", 0, density=3.0)
    (cloud,), _ = open_inputs(folder / "house")
    frame = frame_of([cloud])
    tile = replace(read_tile(cloud.path), frame=frame)
    result = reconstruct_tile(tile, PipelineConfig())
    one = products_of(result, frame, rasterise_tile(result.classified, RasterConfig(), frame))
    side = int(np.ceil(np.sqrt(n)))
    own = [moved(one, number, *divmod(number, side)) for number in range(n)]
    return lambda: merge(folder / "out", [cloud.input_file] * n, frame, own)


def frames(_: Path, n: int) -> Callable[[], object]:
    """Return the placing of ten scans over a chain of so many moving frames."""
    names = ["map", *(f"frame_{number}" for number in range(n - 2)), "lidar"]

    def call() -> None:
        placer = ScanPlacer()
        for second in range(12):
            for parent, child in pairwise(names):
                placer.add_transforms(
                    transform_of(float(second), parent, child, 0.001 * second), is_static=False
                )
            if 0 < second < 11:
                placer.add_scan(scan_of(second - 0.5, np.ones((20, 2)), np.zeros(20, "<f4")))
        if sum(len(one.points) for one in placer.placed(is_end=True)) < 200:
            raise ValueError("points were left out")

    return call


def topics(folder: Path, n: int) -> Callable[[], object]:
    """Return the summary of a bag with so many topics."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = store.types["std_msgs/msg/String"]
    data = store.serialize_cdr(kind("text"), kind.__msgtype__)
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for number in range(n):
            topic = writer.add_connection(f"/topic_{number}", kind.__msgtype__, typestore=store)
            for time_ns in range(10):
                writer.write(topic, time_ns, data)
    return lambda: summarise_bag(folder / "bag")


def strips(folder: Path, n: int) -> Callable[[], object]:
    """Return the cutting into tiles of a file with so many strips."""
    path = folder / "strips.las"
    cloud = _cloud(path, 200_000, 400.0)
    cloud.point_source_id = (cloud.x * n / 401.0).astype(np.uint16) + 1
    cloud.write(path)
    return lambda: _tiles_of(path)


def classes(folder: Path, n: int) -> Callable[[], object]:
    """Return the summary of a file with so many classes."""
    path = folder / "classes.las"
    cloud = _cloud(path, 200_000, 400.0)
    cloud.classification = np.arange(200_000) % n
    cloud.write(path)
    return lambda: summarise_cloud(path)


#: Kind → how it is prepared, and its numbers.
KINDS: dict[str, tuple[Prepare, tuple[int, ...]]] = {
    "vertices": (vertices, (125_000, 250_000, 500_000, 1_000_000)),
    "holes": (holes, (31_250, 62_500, 125_000, 250_000)),
    "crossings": (crossings, (625, 1_250, 2_500, 5_000)),
    "footprints": (footprints, (12_500, 25_000, 50_000, 100_000)),
    "copies": (copies, (12_500, 25_000, 50_000, 100_000)),
    "outlines": (outlines, (125, 250, 500, 1000)),
    "faces": (faces, (128, 256, 512, 1024)),
    "buildings": (buildings, (16, 32, 64, 128)),
    "frames": (frames, (125, 250, 500, 1000)),
    "files": (files, (250, 500, 1000, 2000)),
    "tiles": (tiles, (50, 100, 200, 400)),
    "topics": (topics, (100, 200, 400, 800)),
    "strips": (strips, (25, 50, 100, 200)),
    "classes": (classes, (32, 64, 128, 256)),
}


def main() -> None:
    """Print the times and the exponent of each kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)} (default: all)")
    options = parser.parse_args()
    for kind in options.kinds or KINDS:
        prepare, numbers = KINDS[kind]
        seconds = []
        for n in (numbers[0], *numbers):  # the first one loads what is needed
            with tempfile.TemporaryDirectory(prefix="growth_") as name:
                call = prepare(Path(name), n)
                before = time.process_time()
                call()
                seconds.append(max(time.process_time() - before, 1e-4))
        slope, _ = np.polyfit(np.log(numbers[1:]), np.log(seconds[2:]), 1)
        told = ", ".join(f"{n:,}: {one:.2f} s" for n, one in zip(numbers, seconds[1:], strict=True))
        print(f"{kind:9} exponent {slope:5.2f} {'' if slope <= LINEAR else '(!) '}  {told}", flush=True)


if __name__ == "__main__":
    main()
