"""The classified clouds of a run: tiles' results in the order of a cloud's points, and clouds with them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.core.model.tile import COLUMNS
from lidar_buildings.io.clouds.classified_las import suffix_for, write_classified
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.doubts import CloudDoubts
from lidar_buildings.io.clouds.find_inputs import InputFile, changed, check_unchanged
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.files.atomic_files import atomic_file, writing
from lidar_buildings.io.results.run_folder import CLASSIFIED, PARTIAL, Share, output_names
from lidar_buildings.io.results.tile_products import load_rows, load_sources

#: About so many points at most are read for a page, as that takes longest.
MOST_READ = 3_000_000
_STRETCH = 50_000


def every_stretch(n_points: int) -> int:
    """Return of how many stretches of clouds with so many points one is read."""
    return max(1, -(-n_points // MOST_READ))


def stretches(cloud: Cloud, every: int) -> Iterator[laspy.ScaleAwarePointRecord]:
    """Read a cloud's points; of every so many stretches one."""
    if every == 1:
        yield from cloud.chunks()
        return
    firsts = range(0, cloud.point_count, every * _STRETCH)
    runs = [(first, min(first + _STRETCH, cloud.point_count)) for first in firsts]
    yield from (points for _, points in cloud.runs(runs))


_COLUMNS = ("classification", "height_above_ground", "facade", "view", "building_id", "plane_id", "edge")
#: What is known of a point; `known` is 0 for points that no finished tile holds.
RESULT = np.dtype([("known", "u1"), *((name, COLUMNS[name]) for name in _COLUMNS)])
#: Records written at a time when the table is made (13 MB).
_BLOCK = 1 << 20


class PointResults:
    """A table on disk, one row per point of an input file."""

    def __init__(self, path: Path, n_points: int) -> None:
        self._path = path
        # written in full before it is mapped: a full disk is then an error, not a bus error
        with atomic_file(path) as temporary, open(temporary, "wb") as file:
            for start in range(0, n_points, _BLOCK):
                file.write(bytes(min(_BLOCK, n_points - start) * RESULT.itemsize))
        self._table: NDArray[Any] = (
            np.memmap(path, RESULT, mode="r+", shape=(n_points,)) if n_points else np.zeros(0, RESULT)
        )

    def __enter__(self) -> PointResults:
        return self

    def __exit__(self, *_: object) -> None:
        self._table = np.zeros(0, RESULT)
        self._path.unlink(missing_ok=True)

    def rows(self, first: int, last: int) -> NDArray[Any]:
        """Return the rows `first` to `last` (exclusive)."""
        return np.asarray(self._table[first:last])

    def count(self, column: str, least: int = 1) -> int:
        """Count the points of which a column says something, as a number from the least on."""
        return int(np.count_nonzero(self._table[column] >= least))

    def fill(self, fragments: Iterable[Path], source: int, *, without: Collection[int] = ()) -> None:
        """
        Enter the results of saved tiles, in the order given, of one input; some buildings are left out.

        A building's own tile has the last word on its points, which may be core points of another tile.
        """
        left_out = np.array(sorted(without), dtype=np.uint32)
        paths = list(fragments)
        for name in ("core", "edges", "roofs"):
            for path in paths:
                rows = load_rows(path, name, source)
                mine = rows.compress(rows["index"] < len(self._table))
                if name == "roofs" and len(left_out):
                    mine = mine.compress(~np.isin(mine["building_id"], left_out))
                if name == "core":
                    self._table["known"][mine["index"]] = 1
                for column in set(mine.dtype.names or ()).intersection(RESULT.names or ()):
                    self._table[column][mine["index"]] = mine[column]


#: What one input's file is written from: folder, number, input, name, saved tiles, buildings to leave out,
#: frame.
_Job = tuple[Path, int, InputFile, str, list[Path], Collection[int], MapFrame | None]


class WrittenCloud(NamedTuple):
    """What became of one input."""

    output: str | None = None  #: the file's name in the output folder, None where the input could not be read
    problem: str = ""  #: why it is missing, empty if it is not
    per_class: NDArray[np.int64] | int = 0  #: number of points per class, shape (256,), or 0
    n_known: int = 0  #: points in finished tiles
    n_facade: int = 0  #: points of façades
    #: Points that were seen from the street, and those of them at places that were seen from above, too.
    n_street: int = 0
    n_covered: int = 0
    #: What the input says that can hardly be so, or what its output lacks.
    remarks: tuple[Remark, ...] = ()


def write_clouds(
    folder: Path,
    inputs: Sequence[InputFile],
    fragments: Sequence[Path],
    *,
    without: Collection[int],
    share: Share = map,
    frame: MapFrame | None = None,
) -> list[WrittenCloud]:
    """
    Write every input's classified file; an input that cannot be read is noted, the others are written.

    `fragments` are saved tiles, sorted by stamp; `without` are ids of buildings to leave out. `share`, as
    `map`, may do several files at the same time, in other processes. Points that the frame cannot hold are
    noise. OutputError if a file cannot be written.
    """
    touching: list[list[Path]] = [[] for _ in inputs]
    for fragment in fragments:
        for source in load_sources(fragment):
            if source < len(inputs):
                touching[source].append(fragment)
    if inputs:
        with writing(folder / CLASSIFIED):
            (folder / CLASSIFIED).mkdir(exist_ok=True)
    jobs = [
        (folder, number, one, name, touching[number], without, frame)
        for number, (one, name) in enumerate(zip(inputs, output_names(inputs), strict=True))
    ]
    return list(share(_write_cloud, jobs))


def _write_cloud(job: _Job) -> WrittenCloud:
    folder, number, file, name, fragments, without, frame = job
    try:
        check_unchanged(file)
        cloud = replace(open_cloud(file.path).in_frame(frame), kept=file.kept)
        if cloud.point_count != file.point_count:
            raise changed(cloud.path)
        output = f"{CLASSIFIED}/{name}{suffix_for(cloud)}"
        with PointResults(folder / PARTIAL / f"{number}.results", cloud.point_count) as results:
            results.fill(fragments, number, without=without)
            doubts = CloudDoubts(cloud, frame, file.path.name)
            views = [results.count("view", least) for least in (View.STREET, View.COVERED)]
            written = write_classified(cloud, results.rows, folder / output, doubts, has_views=views[0] > 0)
            is_own = folder / PARTIAL in file.path.parents  # of a bag
            remarks = () if is_own else (*doubts.remarks(), *written.remarks)
            known, facade = results.count("known"), results.count("facade")
            return WrittenCloud(output, "", written.per_class, known, facade, *views, remarks)
    except InputError as error:
        return WrittenCloud(problem=str(error))
