"""The kinds of cloud: a file by its header, and one that was opened and checked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.input_file import InputFile, check_unchanged
from lidar_buildings.io.clouds.las_crs import SourceCrs
from lidar_buildings.io.clouds.las_reader import open_chunks, open_reader
from lidar_buildings.io.clouds.las_records import RawHeader
from lidar_buildings.io.files.failures import reported

#: Points read at a time: about 60 MB with all that is made of them.
CHUNK = 500_000


@dataclass(frozen=True, eq=False)
class CloudExtent:
    """A LAS, LAZ or COPC file by its header."""

    path: Path
    raw: RawHeader  #: header and records byte for byte
    crs: SourceCrs  #: what it says of its coordinates
    #: Bounds in source coordinates; NaN if the file holds no point. Shape (3,).
    mins: NDArray[np.float64]
    maxs: NDArray[np.float64]
    state: tuple[int, int]  #: size [bytes] and time of the last change [ns] when it was opened

    @property
    def point_count(self) -> int:
        """Number of points."""
        return self.raw.point_count

    @property
    def units(self) -> NDArray[np.float64]:
        """Metres per source unit, per axis."""
        return np.array([self.crs.horizontal_unit, self.crs.horizontal_unit, self.crs.vertical_unit])


@dataclass(frozen=True, eq=False)
class Cloud(CloudExtent):
    """
    A checked file, as laspy parses its `header`, too; it is not kept open.

    Its bounds hold for its points, also where those in the header do not.
    """

    header: laspy.LasHeader
    kept: Path | None = None  #: where its points are decoded, once they have been read

    @property
    def input_file(self) -> InputFile:
        """What a run notes of it."""
        return InputFile(self.path, self.point_count, self.state, self.kept)

    @property
    def point_count(self) -> int:
        """Number of points."""
        return int(self.header.point_count)

    def chunks(
        self, size: int = CHUNK, first: int = 0, last: int | None = None
    ) -> Iterator[laspy.ScaleAwarePointRecord]:
        """
        Read the points `first` to `last` in file order, `size` at a time.

        InputError if they cannot be read to the last one, or the file is not the one that was opened.
        """
        run = first, self.point_count if last is None else last
        yield from (points for _, points in self.runs([run], size))

    def runs(
        self, runs: Sequence[tuple[int, int]], size: int = CHUNK
    ) -> Iterator[tuple[int, laspy.ScaleAwarePointRecord]]:
        """
        Read points from one to another (exclusive), time and again, as `chunks` and with its errors.

        Yields the place in the file of the first point, and at most `size` points.
        """
        check_unchanged(self.input_file)
        if self.kept is not None and self.kept.exists():
            yield from self._kept_runs(self.kept, runs, size)
            check_unchanged(self.input_file)
            return
        is_plain = self.raw.has_equal_chunks or all(first == 0 for first, _ in runs)
        opened = open_reader(self.path) if is_plain else open_chunks(self.path, self.header)
        with reported(self.path), opened as (reader, guard):
            for done, end in runs:
                if done:
                    with guard():
                        reader.seek(done)
                while done < end:
                    with guard():
                        points = reader.read_points(min(size, end - done))
                    if len(points) == 0:
                        raise InputError(
                            f"{self.path}: is cut short ({done} of {self.point_count} points): copy it again"
                        )
                    yield done, points
                    done += len(points)
        check_unchanged(self.input_file)

    def _kept_runs(
        self, kept: Path, runs: Sequence[tuple[int, int]], size: int
    ) -> Iterator[tuple[int, laspy.ScaleAwarePointRecord]]:
        form, scaling = self.header.point_format, (self.header.scales, self.header.offsets)
        for done, end in runs:
            for first in range(done, end, size):
                rows = np.fromfile(kept, form.dtype(), min(size, end - first), offset=first * form.size)
                yield first, laspy.ScaleAwarePointRecord(rows, form, *scaling)
