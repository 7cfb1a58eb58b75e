"""Small clouds for the tests of files: every format, version and reference system."""

from __future__ import annotations

import errno
import io
import os
import struct
from pathlib import Path

import laspy
import lazrs
import numpy as np
import pyproj
from laspy._compression.lazrsbackend import LazrsPointWriter

#: Oldest version in which laspy writes each point format.
VERSIONS = {0: "1.1", 1: "1.1", 2: "1.2", 3: "1.2", 4: "1.3", 5: "1.3"} | dict.fromkeys(range(6, 11), "1.4")
_FREE_BITS = {"X", "Y", "Z"}


def random_cloud(
    n_points: int = 500,
    *,
    point_format: int = 1,
    version: str | None = None,
    corner: tuple[float, float, float] = (85000.0, 447000.0, 2.0),
    size: tuple[float, float, float] = (100.0, 80.0, 20.0),
    seed: int = 0,
) -> laspy.LasData:
    """Return a cloud with chance values in every dimension."""
    random = np.random.default_rng(seed)
    header = laspy.LasHeader(point_format=point_format, version=version or VERSIONS[point_format])
    header.scales, header.offsets = np.array([0.001, 0.001, 0.01]), np.array([84000.0, 447000.0, 0.0])
    cloud = laspy.LasData(header)
    cloud.xyz = np.array(corner) + random.uniform(0.0, 1.0, (n_points, 3)) * size
    fill(cloud.points.array, random)
    return cloud


def fill(points: np.ndarray, random: np.random.Generator) -> None:
    """Put chance values into every dimension but the coordinates; GPS times rise from a time in 2022."""
    for name in points.dtype.names:
        kind = points.dtype[name]
        if name in _FREE_BITS:
            continue
        if name == "gps_time":
            points[name] = 3.3e8 + np.sort(random.uniform(0.0, 100.0, len(points)))
        elif kind.kind in "iu":
            info = np.iinfo(kind)
            points[name] = random.integers(max(info.min, -(2**40)), min(info.max, 2**40), len(points))
        else:
            points[name] = random.normal(size=len(points))
    if "scan_angle" in points.dtype.names:
        points["scan_angle"] = random.integers(-5000, 5000, len(points))


def with_geo_keys(cloud: laspy.LasData, keys: dict[int, int]) -> laspy.LasData:
    """Add a GeoTIFF key directory."""
    entries = np.array(
        [[1, 1, 0, len(keys)], *([key, 0, 1, value] for key, value in keys.items())], dtype="<u2"
    )
    cloud.header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", entries.tobytes()))
    return cloud


def with_wkt(cloud: laspy.LasData, crs: str) -> laspy.LasData:
    """Add a WKT record: of a code, or the text as it is."""
    text = pyproj.CRS(crs).to_wkt("WKT1_GDAL") if crs.startswith("EPSG") else crs
    cloud.header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0"))
    cloud.header.global_encoding.wkt = True
    return cloud


def saved(cloud: laspy.LasData, path: Path) -> Path:
    """Write a cloud, compressed if the path ends so."""
    cloud.write(path)
    return path


def patched(path: Path, at: int, content: bytes) -> Path:
    """Overwrite bytes of a file."""
    data = bytearray(path.read_bytes())
    data[at : at + len(content)] = content
    path.write_bytes(data)
    return path


def shortened(path: Path, share: float) -> Path:
    """Cut a file's end off."""
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


class VariableChunks:
    """A backend that writes LAZ with chunks of varying size, as COPC files have them."""

    def is_available(self) -> bool:
        return True

    def create_writer(self, file, header):
        return _VariableChunkWriter(file, header.point_format)


class _VariableChunkWriter(LazrsPointWriter):
    def __init__(self, file, point_format) -> None:
        super().__init__(file, point_format, parallel=False)
        self.vlr = lazrs.LazVlr.new_for_compression(point_format.id, point_format.num_extra_bytes, True)

    def write_points(self, points) -> None:
        super().write_points(points)
        self.compressor.finish_current_chunk()


def saved_copc(cloud: laspy.LasData, path: Path, level: int = 2) -> Path:
    """Write a cloud as COPC whose nodes are all of one level; its points are put in their order."""
    places = np.asarray(cloud.xyz)
    low, side = places.min(axis=0), float(np.ptp(places, axis=0).max())
    cells = np.minimum((places - low) / side * 2**level, 2**level - 1).astype(np.int64)
    nodes, own, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    cloud.points = cloud.points[np.argsort(own.ravel(), kind="stable")]
    cloud.header.vlrs[:] = [one for one in cloud.header.vlrs if one.user_id != "laszip encoded"]
    cloud.header.vlrs.insert(0, laspy.VLR("copc", 1, "COPC info VLR", bytes(160)))
    hierarchy = laspy.VLR("copc", 1000, "EPT Hierarchy", bytes(32 * len(nodes)))
    ends = np.cumsum(counts)
    with open(path, "wb+") as file:
        writer = laspy.LasWriter(
            file, cloud.header, do_compress=True, laz_backend=VariableChunks(), closefd=False
        )
        for first, end in zip(ends - counts, ends, strict=True):
            writer.write_points(cloud.points[first:end])
        writer.write_evlrs(laspy.vlrs.vlrlist.VLRList([hierarchy]))
        writer.close()
        header = writer.header
        file.seek(header.offset_to_point_data)
        laszip = header.vlrs.get("LasZipVlr")[0].record_data
        sizes = [size for _, size in lazrs.read_chunk_table(file, lazrs.LazVlr(laszip))][: len(nodes)]
        begins = header.offset_to_point_data + 8 + np.cumsum([0, *sizes[:-1]])
        start = header.start_of_first_evlr + 60
        file.seek(375 + 54)
        half = side / 2.0
        file.write(struct.pack("<5d2Q", *(low + half), half, side / 128, start, 32 * len(nodes)))
        file.seek(start)
        for node in zip(nodes.tolist(), begins.tolist(), sizes, counts.tolist(), strict=True):
            file.write(struct.pack("<4iQ2i", level, *node[0], *node[1:]))
    return path


def fill_the_disk(monkeypatch, part_of_name: str, allowed: int) -> None:
    """Let writing to files whose name holds `part_of_name` fail after so many bytes, as on a full disk."""
    plain = open

    class Filling(io.FileIO):
        left = allowed

        def write(self, data) -> int:
            self.left -= memoryview(data).nbytes
            if self.left < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return super().write(data)

    def filling(name, mode="r", *args, **kwargs):
        is_meant = isinstance(name, str | os.PathLike) and part_of_name in os.path.basename(name)
        if not is_meant or "r" in mode:
            return plain(name, mode, *args, **kwargs)
        raw = Filling(name, mode.replace("b", "").replace("t", ""))
        file = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        return file if "b" in mode else io.TextIOWrapper(file, encoding="utf-8", write_through=True)

    monkeypatch.setattr("builtins.open", filling)
    monkeypatch.setattr(io, "open", filling)
