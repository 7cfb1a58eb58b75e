"""Tiles read ahead in a thread of their own, so that the player's callbacks do not wait for the disk."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.tiling.spooled_tile import SpooledTile
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.ros.stamps import tile_of

#: Tiles read ahead: enough to read while one is sent, and no more memory.
_AHEAD = 1
#: Timeout of a wait for room in the queue, after which stopping is noticed [s].
_TRY = 0.1


class TileReader:
    """
    Reads the tiles of a source one after the other.

    The pool's processes put tiles together, if there is one. `error` is what ended the reading;
    `is_exhausted` says whether every tile has been read (and perhaps not yet taken).
    """

    def __init__(self, source: TileSource, pool: BuildingPool) -> None:
        self.error: Exception | None = None
        self.is_exhausted = False
        self._source = source
        self._pool = pool
        self._tiles: queue.Queue[PointTile] = queue.Queue(maxsize=_AHEAD)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tile_reader", daemon=True)
        self._on_tile: Callable[[], None] = lambda: None

    @property
    def tile_count(self) -> int:
        """Number of tiles, as the source knows it."""
        return self._source.tile_count

    def start(self, on_tile: Callable[[], None]) -> None:
        """Begin to read; `on_tile` is called, from the reading thread, when there is something to take."""
        self._on_tile = on_tile
        self._thread.start()

    def take(self) -> PointTile | None:
        """Return the next tile, None if none is ready."""
        try:
            return self._tiles.get_nowait()
        except queue.Empty:
            return None

    def grown(self, tile: PointTile, sides: Sides) -> PointTile | None:
        """Return a tile with a larger buffer on some sides, None if there is none."""
        return self._source.grown(tile_of(tile.stamp), sides)

    def stop(self) -> None:
        """Stop reading and wait for the thread."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        """Read until the end, an error, or `stop`."""
        try:
            for tile in self._source.ready():
                if not self._put(self._pool.call(SpooledTile.read, tile.alone())):
                    return
                self._on_tile()
            self.is_exhausted = True
        except Exception as error:
            self.error = error
        if not self._stopping.is_set():
            self._on_tile()

    def _put(self, tile: PointTile) -> bool:
        """Put a tile into the queue as soon as there is room; False when stopping."""
        while not self._stopping.is_set():
            try:
                self._tiles.put(tile, timeout=_TRY)
                return True
            except queue.Full:
                continue
        return False
