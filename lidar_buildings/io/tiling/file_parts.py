"""Files read in parts by several processes: the points of each go to a store of its own."""

from __future__ import annotations

import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from lidar_buildings.core.model.errors import InputError, LidarBuildingsError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.cloud import CHUNK, Cloud
from lidar_buildings.io.files.temporary_folder import temporary_files
from lidar_buildings.io.tiling.tile_grid import Cell, TileGrid
from lidar_buildings.io.tiling.tile_store import ReadPart, TileStore

#: So many parts are handed out ahead at least, as long as there are files: wide margin over the workers.
AHEAD = 1000
#: Points of a part: enough that a process is busy for seconds, and whole chunks.
PART = 10 * CHUNK
#: Points are kept decoded where there is so many times the room that they take; wide margin: a run takes
#: 70 bytes a point in all, and as much as its inputs twice.
_ROOM = 8


class FilePart(NamedTuple):
    """A part of a file, and where its points are put."""

    cloud: Cloud
    source: int  #: its place among the inputs
    #: The first point, and the one behind the last.
    first: int
    last: int
    grid: TileGrid  #: of tiles and spool cells
    frame: MapFrame
    folder: Path  #: one that all processes see


Answer: TypeAlias = "Future[ReadPart]"
#: Calls a function with a part in another process: ``submit(read_part, part)``.
Submit = Callable[[Callable[..., Any], FilePart], Answer]


def read_files(
    clouds: Sequence[Cloud], order: Sequence[int], store: TileStore, submit: Submit | None = None
) -> Iterator[tuple[int, Iterator[set[Cell]]]]:
    """
    Bring files to a store, one after the other in an order; a point's `source` is its file's place.

    `submit` reads parts in other processes, many ahead; files are read here, chunk by chunk, if it is not
    given. Yields each file, and an iterator over the tiles of the points of each chunk or part, which raises
    an `InputError` where the file cannot be read on.
    """
    if submit is None:
        for source in order:
            yield source, _read_here(clouds[source], source, store)
        return
    waiting: deque[list[Answer]] = deque()
    ahead, n_ahead = iter(order), 0
    for source in order:
        while n_ahead < AHEAD and (number := next(ahead, None)) is not None:
            waiting.append([submit(read_part, part) for part in parts_of(clouds[number], number, store)])
            n_ahead += len(waiting[-1])
        answers = waiting.popleft()
        yield source, _joined(clouds[source], source, store, answers)
        n_ahead -= len(answers)


def kept_in(folder: Path, clouds: Sequence[Cloud]) -> list[Cloud]:
    """Let LAZ files be decoded but once, where there is plenty of room for their points in a folder."""
    sizes = [cloud.point_count * cloud.header.point_format.size for cloud in clouds]
    if shutil.disk_usage(folder).free < _ROOM * sum(sizes):
        return list(clouds)
    return [
        replace(cloud, kept=folder / f"{number}.decoded")
        if cloud.point_count and cloud.header.are_points_compressed
        else cloud
        for number, cloud in enumerate(clouds)
    ]


def _read_here(cloud: Cloud, source: int, store: TileStore) -> Iterator[set[Cell]]:
    first, part = 0, store.spool.folder / f"{source}.part"
    for chunk in cloud.chunks(CHUNK):
        if cloud.kept is not None:
            with temporary_files(store.spool.folder), open(part, "ab") as file:
                file.write(chunk.array.data)
        yield store.add(source, first, chunk, cloud)
        first += len(chunk)
    if cloud.kept is not None:
        part.rename(cloud.kept)


def _joined(cloud: Cloud, source: int, store: TileStore, answers: Iterable[Answer]) -> Iterator[set[Cell]]:
    for answer in answers:
        try:
            part = answer.result()
        except RuntimeError as error:
            raise InputError(f"{cloud.path}: no worker can read it: {error}") from error
        yield store.join(source, part)


def parts_of(cloud: Cloud, source: int, store: TileStore) -> Iterator[FilePart]:
    """Cut a file into parts for a store."""
    for first in range(0, cloud.point_count, PART):
        last = min(first + PART, cloud.point_count)
        yield FilePart(cloud, source, first, last, store.grid, store.frame, store.spool.folder)


def read_part(part: FilePart) -> ReadPart:
    """Read a part, and return where its points are; InputError or OutputError if it cannot be read."""
    store = TileStore(part.grid, part.frame, part.folder)
    try:
        first = part.first
        for chunk in part.cloud.chunks(first=first, last=part.last):
            store.add(part.source, first, chunk, part.cloud)
            first += len(chunk)
        with temporary_files(part.folder):
            return store.part(part.source)
    except LidarBuildingsError:
        store.spool.remove()
        raise
