"""
The tiles of files, given out as those of a live feed are (`LiveFeed`).

Who sends tiles on, with or without ROS, needs no more than this::

    queue.start(wake)                    # wake() is called, in another thread, when there is something to do
    tile = queue.take()                  # the next tile; None if none is ready
    larger = queue.grown(tile, sides)    # once more, with a larger buffer; None if there is no more
    queue.finish(stamp, is_done=...)     # a revision of a tile is done, or was given up
    queue.n_left                         # tiles that are still to be taken, as far as is known
    queue.stop()

A survey is done when `n_left` is 0 and all that was taken is done. `FileQueue` reads files, `LiveFeed` takes
scans. Where results go is `lidar_buildings.io.results.output_folder.OutputFolder`: it says which tiles are on
disk, so that they are not taken again, and makes the files.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from lidar_buildings.core.model.ids import tile_of
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.sides import ALL, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.tiling.tile_store import SpooledTile
from lidar_buildings.io.tiling.tiling import TileSource

#: Tiles that are read or wait to be taken: one is read while another is sent, and no more memory.
_AHEAD = 2


class FileQueue:
    """
    The tiles of a source of files, read ahead in a thread, so that no callback waits for the disk.

    `read` puts a tile together, in another process for instance. `error` is what ended the reading.
    """

    def __init__(
        self, source: TileSource, read: Callable[[SpooledTile], PointTile] = SpooledTile.read
    ) -> None:
        self.error: Exception | None = None
        self._source, self._read_tile = source, read
        self._tiles = source.ready()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="tile_reader")
        self._coming: deque[Future[PointTile | None]] = deque()
        self._is_exhausted = False
        self._n_taken = 0
        self._wake: Callable[[], None] = lambda: None

    @property
    def frame(self) -> MapFrame:
        """Where the map lies."""
        return self._source.frame

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

    def finish(self, stamp: int, *, is_done: bool = True) -> None:
        """Note that a tile is done: files have nothing to keep for it."""

    def stop(self) -> None:
        """Stop reading, wait for the thread, and delete the temporary files."""
        self._wake = lambda: None
        self._thread.shutdown(cancel_futures=True)
        self._source.close()

    def _read_on(self) -> None:
        self._coming.append(self._thread.submit(self._read))
        self._coming[-1].add_done_callback(lambda _: self._wake())

    def _read(self) -> PointTile | None:
        """Read one tile; None behind the last one."""
        tile = next(self._tiles, None)
        return None if tile is None else self._read_tile(tile.alone())
