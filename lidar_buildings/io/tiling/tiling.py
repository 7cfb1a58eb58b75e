"""Clouds of any size cut into tiles with a buffer, as they stream in."""

from __future__ import annotations

import os
import threading
import weakref
from collections import deque
from collections.abc import Container, Generator, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import shapely

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.ids import STEP
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.sides import ALL, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.clouds.agreement import excess_of
from lidar_buildings.io.clouds.las import frame_of, open_inputs
from lidar_buildings.io.tiling.file_parts import Submit, kept_in, read_files
from lidar_buildings.io.tiling.spool import Head
from lidar_buildings.io.tiling.tile_grid import Block, Buffer, Cell, Rectangle, TileGrid
from lidar_buildings.io.tiling.tile_size import reading_order, spread_of, tiles_for
from lidar_buildings.io.tiling.tile_stamps import stamp_of_number, stamp_of_time
from lidar_buildings.io.tiling.tile_store import KnownSurvey, SpooledTile, TileStore
from lidar_buildings.io.tiling.tiling_config import TilingConfig

__all__ = ["TileSource", "TilingConfig"]


class TileSource:
    """
    Reads clouds once, in chunks, and makes tiles of them.

    A tile comes as soon as every file near it has been read; points go through a temporary folder on disk, so
    that memory holds a chunk and a tile, whatever the size of the files. Every point is a core point of one
    tile. Iterating again starts with the first tile again, from the temporary folder.

    `paths` are files, folders and globs; `skip` holds stamps of tiles that are not wanted (again); `submit`
    reads parts of files in other processes, which see the temporary folder, as of `io.tiling.file_parts`. If
    LAZ files are wanted again, `keep`, their points stay there decoded where there is room. `known` is what
    an earlier source of the same survey has learnt, `crs` the system of files that name none.

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
        self._skip, self._submit = skip, submit
        self._areas = [Rectangle.of_cloud(cloud) for cloud in self._clouds]
        self._bounds = shapely.STRtree([area and shapely.box(*area) for area in self._areas])
        known = known or KnownSurvey(*tiles_for(self.config, *spread_of(self._clouds)))
        self._buffer = known.buffer
        self._grid = TileGrid.fitting(known.tile_size, self._buffer, known.start)
        self._unread = set(range(len(self._clouds)))
        self._read: deque[int] = deque()
        self._expected = self._grid.tiles_touching(filter(None, self._areas))
        self._around = Rectangle.around([area for area in self._areas if area] or [Rectangle(0, 0, 0, 0)])
        self._waiting: set[Cell] = set()
        self._planned: set[Cell] = set()
        self._tiles: list[SpooledTile] = []
        self._by_stamp: dict[int, SpooledTile] = {}
        self._lock = threading.RLock()
        self._closed = threading.Event()
        self._store = TileStore(self._grid, self.frame, temporary, known.spacing)
        self._store.brightness.recall(known.dark_limit, known.scales)
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
                if self._closed.is_set() or (number == len(self._tiles) and not self._read_on()):
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

    def _read_on(self) -> bool:
        """Read one more chunk; False if there is nothing left to read."""
        return next(self._steps, False)

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
                self._store.brightness.learn(source)
            self._unread.discard(source)
            self._plan_tiles_near(self._areas[source])
            yield True
        if len(self.unreadable) == len(self._clouds):
            raise InputError("\n".join(self.problems))
        for tile in sorted(self._waiting):
            self._plan(tile)
        yield True

    def _learn_spacing(self) -> None:
        """
        Measure the survey's spacing before the first tile is planned, in the middle of what there is.

        A survey that has been read whole by then is measured as one, so that a small one comes out the same
        in one file and in many; of a larger one the first file that can tell does.
        """
        if self._store.spacing is None and not self._unread:
            self._store.learn_spacing(self._around)
        while self._read and self._store.spacing is None:
            source = self._read.popleft()  # one that cannot tell is not asked again
            area = self._areas[source]
            if area is not None:
                self._store.learn_spacing(area, source)

    def _plan_tiles_near(self, read: Rectangle | None) -> None:
        """
        Plan the waiting tiles for which the file just read was the last one near.

        Points outside all headers' bounds, and those that come after their tile was planned, wait for the
        end, since nothing says which file brings more of them.
        """
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
        stamp, dark_limit = self._stamp(tile, first_point), self._store.brightness.dark_limit
        buffer, most = Buffer.of(self._buffer), self.config.max_buffer
        ready = SpooledTile(self._store, stamp, block, core, buffer, most, dark_limit)
        self._tiles.append(ready)
        self._by_stamp[stamp] = ready

    def _stamp(self, tile: Cell, first_point: Head) -> int:
        """Return a stamp for the tile that no other tile has."""
        encoding = self._clouds[first_point.source].header.global_encoding
        is_standard = bool(encoding.gps_time_type)
        stamp = stamp_of_time(first_point.gps_time, is_standard=is_standard)
        if stamp is None:
            stamp = stamp_of_number(self._grid.number_of(tile, self._around))
        while stamp in self._by_stamp:
            stamp += STEP
        return stamp
