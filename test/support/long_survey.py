"""A survey that is made up as it is read, and how much memory it takes: a process of its own imports this."""

import tracemalloc
from pathlib import Path

import laspy
import numpy as np

from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.clouds.las_crs import SourceCrs
from lidar_buildings.io.clouds.las_records import RawHeader
from lidar_buildings.io.tiling import tiling


class LongCloud:
    """A cloud that makes its chunks up as they are asked for."""

    crs = SourceCrs()
    units = np.ones(3)
    mins, maxs = np.array([0.0, 0.0, 0.0]), np.array([4000.0, 500.0, 10.0])
    path, kept = "made-up.laz", None
    raw = RawHeader(b"", (), (), 0)

    def __init__(self, n_chunks, chunk_size):
        self.n_chunks, self.chunk_size = n_chunks, chunk_size
        self.point_count = n_chunks * chunk_size
        self.header = laspy.LasHeader(point_format=1)
        self.input_file = InputFile(Path(self.path), self.point_count)

    def in_frame(self, frame):
        return self

    def chunks(self, size):
        for number in range(self.n_chunks):
            random = np.random.default_rng(number)
            chunk = laspy.ScaleAwarePointRecord.zeros(self.chunk_size, header=self.header)
            west = 4000.0 * number / self.n_chunks
            span = 4000.0 / self.n_chunks
            chunk.x, chunk.y = (
                west + random.uniform(0, span, self.chunk_size),
                random.uniform(0, 500, self.chunk_size),
            )
            yield chunk


def peak_of_surveys(*n_chunks):
    """Read surveys of so many chunks one after the other; return the last one's points, and its peak."""
    config = tiling.TilingConfig(tile_size=150.0, buffer=50.0)
    for number in n_chunks:
        tiling.open_inputs = lambda paths, number=number: ([LongCloud(number, 25_000)], [])
        tracemalloc.start()
        with tiling.TileSource("made-up.laz", config) as source:
            n_points = sum(int(tile.read().is_core.sum()) for tile in source.ready())
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return n_points, peak
