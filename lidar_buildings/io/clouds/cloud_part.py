"""A part of a cloud as a file of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import laspy

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.classified_header import is_kept, written_version
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las import chunks_within
from lidar_buildings.io.clouds.las_reader import laz_backend
from lidar_buildings.io.files.atomic_files import CheckedFile, atomic_file, write_error

_WITH_WAVEFORMS = (4, 5, 9, 10)


def write_part(cloud: Cloud, bounds: Sequence[float], path: Path) -> int:
    """
    Write the points in bounds as LAZ, in their order, with all dimensions and the records that still hold.

    Parameters
    ----------
    cloud : Cloud
        Of COPC only the chunks that touch the bounds are read.
    bounds : sequence of four float
        West, south, east and north, in source coordinates; points on them are within.
    path : Path
        The output.

    Returns
    -------
    int
        How many points were written.

    Raises
    ------
    InputError, OutputError
        If the cloud has waveforms or cannot be read, or the output not be written.
    """
    if cloud.header.point_format.id in _WITH_WAVEFORMS:
        raise InputError(f"{cloud.path}: has waveforms: cut it with another tool, or leave out --bounds")
    header = cloud.header.copy()
    header.set_version_and_point_format(written_version(header), header.point_format)
    header.partial_reset()
    header.vlrs[:] = [one for one in header.vlrs if one.user_id not in ("copc", "laszip encoded")]
    kept = [one for one in cloud.raw.evlrs if is_kept(one) and one.data]
    n_points = 0
    with atomic_file(path) as temporary, open(temporary, "wb+") as plain:
        file = CheckedFile(plain)
        try:
            with laspy.LasWriter(
                file, header, do_compress=True, laz_backend=laz_backend(), closefd=False,
                encoding_errors="ignore",
            ) as writer:  # fmt: skip
                for _, points in chunks_within(cloud, bounds):
                    writer.write_points(points)
                    n_points += len(points)
                if kept:
                    own = (
                        laspy.VLR(one.user_id.decode("ascii", "ignore"), one.record_id, "", one.data)
                        for one in kept
                    )
                    writer.write_evlrs(laspy.vlrs.vlrlist.VLRList(list(own)))
        except InputError:
            raise
        except Exception as error:
            if file.error is None:
                raise
            raise write_error(path, file.error) from error
    return n_points
