"""Clouds of any size cut into tiles with a buffer, as they stream in."""

from __future__ import annotations

import os
import shutil
import threading
import weakref
from collections import deque
from collections.abc import Callable, Container, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import shapely

from lidar_buildings.core.model.errors import InputError, LidarBuildingsError
from lidar_buildings.core.model.ids import STEP, tile_of
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.sides import ALL, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.clouds.agreement import excess_of, in_frame
from lidar_buildings.io.clouds.cloud import CHUNK, Cloud
from lidar_buildings.io.clouds.las import frame_of, open_inputs
from lidar_buildings.io.files.temporary_folder import temporary_files
from lidar_buildings.io.tiling.tile_grid import Block, Buffer, Cell, Rectangle, TileGrid
from lidar_buildings.io.tiling.tile_size import reading_order, spread_of, tiles_for
from lidar_buildings.io.tiling.tile_stamps import stamp_of_number, stamp_of_time
from lidar_buildings.io.tiling.tile_store import KnownSurvey, ReadPart, SpooledTile, TileStore
from lidar_buildings.io.tiling.tiling_config import TilingConfig

#: So many parts are handed out ahead at least, as long as there are files: wide margin over the workers.
AHEAD = 1000
#: Points of a part: enough that a process is busy for seconds, and whole chunks.
PART = 10 * CHUNK
#: Points are kept decoded where there is so many times the room that they take; wide margin: a run takes
#: 70 bytes a point in all, and as much as its inputs twice.
_ROOM = 8


Answer: TypeAlias = "Future[ReadPart]"
#: Calls a function in another process: ``submit(read_part, …)``.
Submit = Callable[..., Answer]


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
            cloud, ends = clouds[number], range(PART, clouds[number].point_count + PART, PART)
            place = store.grid, store.frame, store.spool.folder
            waiting.append([submit(read_part, cloud, number, end - PART, end, *place) for end in ends])
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


def read_part(
    cloud: Cloud, source: int, first: int, last: int, grid: TileGrid, frame: MapFrame, folder: Path
) -> ReadPart:
    """
    Read the points `first` to `last` of a file, and return where they are in a folder that all processes see.

    `source` is the file's place among the inputs. InputError or OutputError if it cannot be read.
    """
    store = TileStore(grid, frame, folder)
    try:
        for chunk in cloud.chunks(first=first, last=min(last, cloud.point_count)):
            store.add(source, first, chunk, cloud)
            first += len(chunk)
        with temporary_files(folder):
            return store.part(source)
    except LidarBuildingsError:
        store.spool.remove()
        raise


__all__ = ["TileSource", "TilingConfig"]


class TileSource:
    """
    Reads clouds once, in chunks, and makes tiles of them.

    A tile comes as soon as every file near it has been read; points go through a temporary folder on disk, so
    that memory holds a chunk and a tile, whatever the size of the files. Every point is a core point of one
    tile. Iterating again starts with the first tile again, from the temporary folder.

    `paths` are files, folders and globs; `skip` holds stamps of tiles that are not wanted (again); `submit`
    reads parts of files in other processes, which see the temporary folder. If LAZ files are wanted again,
    `keep`, their points stay there decoded where there is room. `known` is what an earlier source of the same
    survey has learnt, `crs` the system of files that name none.

    A point's `source` is its file's place in `inputs`, the readable files, of which `unreadable` could not be
    read to their end; `problems` has a line for each of these and each that is missing. InputError if no file
    can be read, or the files do not fit together.
    """

    def __init__(
        self,
        paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
        config: TilingConfig | None = None,
        *,
        temporary: str | Path | None = None,
        skip: Container[int] = (),
        submit: Submit | None = None,
        keep: bool = False,
        known: KnownSurvey | None = None,
        crs: str = "",
    ) -> None:
        self.config = config or TilingConfig()
        self._clouds, self.problems = open_inputs(paths)
        if why := excess_of(len(self._clouds)):
            raise InputError(why)
        self.unreadable: set[int] = set()
        self.frame: MapFrame = frame_of(self._clouds, crs)
        self._clouds = in_frame(self._clouds, self.frame)
        self._skip, self._submit = skip, submit
        self._areas = [Rectangle.of_cloud(cloud) for cloud in self._clouds]
        self._bounds = shapely.STRtree([area and shapely.box(*area) for area in self._areas])
        known = known or KnownSurvey(*tiles_for(self.config, *spread_of(self._clouds)))
        self._buffer = known.buffer
        self._grid = TileGrid.fitting(known.tile_size, self._buffer, known.start)
        self._unread = set(range(len(self._clouds)))
        #: Files of which the spacing may be asked, None for all: the first that tells it counts.
        self._read: deque[int | None] = deque()
        self._expected = self._grid.tiles_touching(filter(None, self._areas))
        self._around = Rectangle.around([area for area in self._areas if area] or [Rectangle(0, 0, 0, 0)])
        self._waiting: set[Cell] = set()
        self._planned: set[Cell] = set()
        self._tiles: list[SpooledTile] = []
        self._by_stamp: dict[int, SpooledTile] = {}
        self._lock = threading.RLock()
        self._closed = threading.Event()
        self._store = TileStore(self._grid, self.frame, temporary, view=self.config.given_view)
        self._store.recall(known)
        self._clouds = kept_in(self._store.spool.folder, self._clouds) if keep else self._clouds
        self.inputs = [cloud.input_file for cloud in self._clouds]
        self._finalizer = weakref.finalize(self, self._store.spool.remove)
        self._steps = self._read_all()

    def ready(self) -> Iterator[SpooledTile]:
        """
        Iterate over the tiles, reading on as far as the next one needs; points stay in the temporary folder.

        InputError if in the end no file could be read, OutputError if the temporary folder is full.
        """
        number = 0
        while True:
            with self._lock:
                if self._closed.is_set() or (number == len(self._tiles) and not next(self._steps, False)):
                    return
                if number == len(self._tiles):
                    continue  # another thread may have its turn, and close
                tile = self._tiles[number]
                number += 1
            if tile.stamp not in self._skip:
                yield replace(tile, buffer=Buffer.of(self._buffer))

    @property
    def tile_count(self) -> int:
        """Number of tiles, skipped ones too; an upper estimate until everything has been read."""
        with self._lock:
            if not self._unread and not self._waiting:
                return len(self._tiles)
            return len(self._tiles) + len(self._expected)

    def is_last(self, tile: SpooledTile) -> bool:
        """Whether no other tile follows, as far as is known."""
        with self._lock:
            return not self._unread and not self._waiting and self._tiles[-1].stamp == tile.stamp

    @property
    def known(self) -> KnownSurvey:
        """What has been learnt of the survey."""
        with self._lock:
            return self._store.known(self._buffer)

    @property
    def stamps(self) -> list[int]:
        """Stamps of the tiles, skipped ones too, as far as these are known."""
        with self._lock:
            return list(self._by_stamp)

    def grown(self, stamp: int, sides: Sides = ALL) -> PointTile | None:
        """
        Return the tile of a stamp once more, its buffer doubled on some sides; None if there is no more.

        ValueError if there is no such tile.
        """
        with self._lock:
            tile = self._by_stamp.get(stamp)
            if tile is None or self._closed.is_set():
                raise ValueError(f"stamp = {stamp}: must be that of a tile that was given out")
            return tile.read() if tile.grow(sides) else None

    def close(self) -> None:
        """Stop iterating, from whatever thread, and delete the temporary folder."""
        self._closed.set()
        with self._lock:
            self._steps.close()
            self._finalizer()

    def __enter__(self) -> TileSource:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read_all(self) -> Generator[bool, None, None]:
        """Read every file, giving way after each chunk, and plan tiles as they become complete."""
        order = reading_order(self._areas)
        for source, tiles_read in read_files(self._clouds, order, self._store, self._submit):
            try:
                for tiles in tiles_read:
                    self._waiting |= tiles
                    self._expected |= tiles - self._planned
                    yield True
            except InputError as error:
                self.problems.append(str(error))
                self._store.drop(source)
                self.unreadable.add(source)
            else:
                self._read.append(source)
                self._store.learn(source)
            self._unread.discard(source)
            if not self._unread:
                self._read.appendleft(None)
            self._plan_tiles_near(self._areas[source])
            yield True
        if len(self.unreadable) == len(self._clouds):
            raise InputError(*self.problems)
        for tile in sorted(self._waiting):
            self._plan(tile)
        yield True

    def _learn_spacing(self) -> None:
        """Measure the spacing of a survey that has been read whole, else of the first file that tells it."""
        while self._read and self._store.lacks_spacing:
            source = self._read.popleft()  # what cannot tell is not asked again
            area = self._around if source is None else self._areas[source]
            if area is not None:
                self._store.learn_spacing(area, source)

    def _plan_tiles_near(self, read: Rectangle | None) -> None:
        """Plan the waiting tiles for which the file just read was the last one near, by headers' bounds."""
        if read is None:
            return
        most = self.config.max_buffer
        near = self._grid.tiles_touching([read.grown(most)]) or self._waiting
        for tile in sorted((self._waiting & near) - self._planned):
            square = self._grid.area_of(self._grid.block_of(tile))
            surroundings = square.buffered(Buffer.largest(most))
            is_last = surroundings.touches(read) and self._unread.isdisjoint(self._files_near(surroundings))
            if is_last and self._files_near(square):
                self._plan(tile)

    def _files_near(self, area: Rectangle) -> list[int]:
        files: list[int] = self._bounds.query(shapely.box(*area)).tolist()
        return files

    def _plan(self, tile: Cell) -> None:
        """Plan a tile, in parts where its points are too many for memory."""
        self._learn_spacing()
        self._waiting.discard(tile)
        self._expected.discard(tile)
        self._planned.add(tile)
        blocks = [self._grid.block_of(tile)]
        while blocks:
            block = blocks.pop()
            is_full = self.config.tile_size == 0.0 and (
                self._store.n_waiting(block) > self.config.max_tile_points
            )
            if is_full and block.width * block.height > 1:
                blocks += block.quarters[::-1]
            else:
                self._plan_block(tile, block)

    def _plan_block(self, tile: Cell, block: Block) -> None:
        """Fix a tile's core points and its stamp; a tile without core points is none."""
        core = self._store.take_core(block)
        first_point = self._store.first_point(core)
        if first_point is None:
            return
        encoding = self._clouds[first_point.source].header.global_encoding
        stamp = stamp_of_time(first_point.gps_time, is_standard=bool(encoding.gps_time_type))
        if stamp is None:
            stamp = stamp_of_number(self._grid.number_of(tile, self._around))
        while stamp in self._by_stamp:
            stamp += STEP
        limits = self._store.brightness.dark_limit, self._store.street_brightness.dark_limit
        buffer, most = Buffer.of(self._buffer), self.config.max_buffer
        ready = SpooledTile(self._store, stamp, block, core, buffer, most, *limits)
        self._tiles.append(ready)
        self._by_stamp[stamp] = ready


#: Tiles that are read or wait to be taken: one is read while another is sent, and no more memory.
_AHEAD = 2


class FileQueue:
    """The tiles of a source, put together by `read` ahead in a thread; `error` is what ended the reading."""

    def __init__(self, source: TileSource, read: Callable[[SpooledTile], PointTile]) -> None:
        self.error: Exception | None = None
        self._source, self._read_tile = source, read
        self._tiles = source.ready()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="tile_reader")
        self._coming: deque[Future[PointTile | None]] = deque()
        self._is_exhausted = False
        self._n_taken = 0
        self._wake: Callable[[], None] = lambda: None

    @property
    def tile_count(self) -> int:
        """Number of tiles, as the source knows it."""
        return self._source.tile_count

    @property
    def n_left(self) -> int:
        """Number of tiles that are still to be taken, one at least until the last one has been."""
        return 0 if self._is_exhausted else max(self.tile_count - self._n_taken, 1)

    def start(self, wake: Callable[[], None]) -> None:
        """Begin to read; `wake` is called, in another thread, when there is something to take."""
        self._wake = wake
        for _ in range(_AHEAD):
            self._read_on()

    def take(self) -> PointTile | None:
        """Return the next tile, None if none is ready."""
        if self.error is not None or not (self._coming and self._coming[0].done()):
            return None
        try:
            tile = self._coming.popleft().result()
        except Exception as error:
            self.error = error
            return None
        if tile is None:
            self._is_exhausted = True
        else:
            self._n_taken += 1
            self._read_on()
        return tile

    def grown(self, tile: PointTile, sides: Sides = ALL) -> PointTile | None:
        """Return a tile with a larger buffer on some sides, None if there is none."""
        return self._source.grown(tile_of(tile.stamp), sides)

    def stop(self) -> None:
        """Stop reading, wait for the thread, and delete the temporary files."""
        self._wake = lambda: None
        self._thread.shutdown(cancel_futures=True)
        self._source.close()

    def _read_on(self) -> None:
        self._coming.append(self._thread.submit(self._read))
        self._coming[-1].add_done_callback(lambda _: self._wake())

    def _read(self) -> PointTile | None:
        tile = next(self._tiles, None)
        return None if tile is None else self._read_tile(tile.alone())
