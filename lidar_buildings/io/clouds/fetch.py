"""
Inputs of a run brought to this machine: files of object stores and web servers, and parts of clouds.

A run reads its inputs more than once, and spools each point in several times the bytes that LAZ takes: one
copy costs the least of the net and little of the disk.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from zlib import crc32

import laspy

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.classified_las import is_kept, written_version
from lidar_buildings.io.clouds.cloud import Cloud, laz_backend
from lidar_buildings.io.clouds.find_inputs import changed, find_inputs
from lidar_buildings.io.clouds.las import chunks_within, open_cloud
from lidar_buildings.io.files.atomic_files import atomic_file, checked_file
from lidar_buildings.io.files.failures import reported
from lidar_buildings.io.files.locations import is_url, open_binary, state_of

#: Files that are fetched at the same time: a single stream fills few lines.
_AT_ONCE = 8
_BLOCK = 1 << 24
_WITH_WAVEFORMS = (4, 5, 9, 10)


def fetched(inputs: Sequence[str], folder: Path, bounds: Sequence[float] | None) -> dict[str, str]:
    """
    Fetch inputs that are elsewhere, or cut all to bounds; what is there from an earlier time is kept.

    Each goes into a folder of its own; without bounds those here, and what cannot be fetched, stay as they
    are. Returned is input → where it came from. InputError or OutputError if there are bounds (west, south,
    east, north) and an input cannot be read or none has points there, or a file not be written.
    """
    sources: list[str | Path] = []
    for one in inputs:
        try:
            sources += find_inputs(one) if bounds is not None or is_url(one) else [one]
        except InputError:
            if bounds is not None:
                raise
            sources.append(one)  # said when it is opened
    with ThreadPoolExecutor(_AT_ONCE) as threads:
        paths = list(threads.map(partial(_brought, folder=folder, bounds=bounds), sources))
    found = {path: str(file) for path, file in zip(paths, sources, strict=True) if path}
    if not found:
        raise InputError(
            f"no input has points in {' '.join(f'{edge:.12g}' for edge in bounds or ())}: check the bounds"
        )
    return found


def _brought(file: str | Path, folder: Path, bounds: Sequence[float] | None) -> str:
    """Return the path of a copy, or of a part; empty where no point is in the bounds."""
    if isinstance(file, str) or (bounds is None and isinstance(file, Path)):
        return str(file)
    try:
        with reported(file):
            state = state_of(file)
        own = folder / f"{crc32(f'{file} {bounds}'.encode()):08x}"
        name = file.name.split("?")[0]  # what a signed URL says besides
        if bounds is not None:
            name = f"{Path(name).stem.removesuffix('.copc')}.laz"
        path, note = own / name, own / "state"
        if note.exists() and note.read_text() == str(state):
            return str(path) if path.exists() else ""
        own.mkdir(parents=True, exist_ok=True)
        if bounds is None:
            _copy(file, path)
        elif not write_part(open_cloud(file), bounds, path):
            path.unlink()
        if state_of(file) != state:
            raise changed(file)
        note.write_text(str(state))
        return str(path) if path.exists() else ""
    except InputError:
        if bounds is None:
            return str(file)
        raise


def _copy(file: Path, path: Path) -> None:
    with reported(file):
        source = open_binary(file)
    with source, atomic_file(path) as temporary, open(temporary, "wb") as target:
        block = b" "
        while block:
            with reported(file):
                block = source.read(_BLOCK)
            target.write(block)


def write_part(cloud: Cloud, bounds: Sequence[float], path: Path) -> int:
    """
    Write the points in bounds as LAZ, in their order, with all dimensions and the records that still hold.

    Points on the bounds (west, south, east, north) are within; of COPC only the chunks that touch them are
    read. Returns how many there were. InputError or OutputError if the cloud has waveforms or cannot be read,
    or the output not be written.
    """
    if cloud.header.point_format.id in _WITH_WAVEFORMS:
        raise InputError(f"{cloud.path}: has waveforms: crop it with another tool, or remove --bounds")
    header = copy.deepcopy(cloud.header)
    header.set_version_and_point_format(
        written_version(header.version, header.point_format.id), header.point_format
    )
    header.partial_reset()
    header.vlrs[:] = [one for one in header.vlrs if one.user_id not in ("copc", "laszip encoded")]
    kept = [one for one in cloud.raw.evlrs if is_kept(one) and one.data]
    n_points = 0
    with (
        checked_file(path) as file,
        laspy.LasWriter(
            file, header, do_compress=True, laz_backend=laz_backend(), closefd=False, encoding_errors="ignore"
        ) as writer,
    ):
        for _, points in chunks_within(cloud, bounds):
            writer.write_points(points)
            n_points += len(points)
        if kept:
            own = (
                laspy.VLR(one.user_id.decode("ascii", "ignore"), one.record_id, "", one.data) for one in kept
            )
            writer.write_evlrs(laspy.vlrs.vlrlist.VLRList(list(own)))
    return n_points
