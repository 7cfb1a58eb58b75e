"""The points of a feed as they come, cut into tiles that are ready when the sensor has left them."""

from __future__ import annotations

import math
import shutil
import threading
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import BEYOND, are_held
from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.ids import STEP, tile_of
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.sides import ALL, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.seen_voxels import SeenVoxels
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.tiling.road_places import RoadPlaces
from lidar_buildings.io.tiling.spool import PointLog, records_of
from lidar_buildings.io.tiling.tile_grid import Block, Buffer, Cell, CellTable, TileGrid
from lidar_buildings.io.tiling.tile_stamps import stamp_of_number, stamp_of_time
from lidar_buildings.io.tiling.tile_store import SpooledTile, TileStore
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig

#: Side of a voxel of a crowded tile, which takes one point [m]: no finer than a building's model needs.
VOXEL = 0.1
#: Share of the most points from which on a tile is crowded.
_CROWDED = 0.5
#: Why points are left out.
CROWDED = f"a tile has many points: keeping one per {VOXEL} m"
TOO_MANY = "a tile has more than max_tile_points"
THINNED = "seen from the street: keeping one per {:g} m"
#: A tile comes again at most so often: its stamps leave room for no more revisions (`ros.stamps`), some of
#: which it needs to grow.
MOST_REVISIONS = 900
#: A tile of which fewer points are new waits longer before it comes again: a scanner on the street sees
#: single far points for long.
_FEW = 0.01
#: Points of a file when they are written as LAZ; `index` counts them anew in each.
POINTS_PER_FILE = 5_000_000
#: After so long without a scan the vehicle's way has ended [s].
_SILENCE = 1.0
#: Makes one number of a tile's column and row.
_KEY = np.array([2**32, 1])
#: Batches of points that wait to be shown in models; the oldest go first.
_MOST_NEWER = 40
#: Points that are written together: fewer open each cell's file more often.
_BATCH = 50_000
#: Spool cells along a buffer's width: narrow ones tell whether points lie in it or just beyond.
_CELLS_PER_BUFFER = 3


@dataclass(eq=False)
class LiveTile:
    """What is known of a tile."""

    place: Cell  #: its column and row in the grid
    stamp: int  #: its key: the stamp of its first revision [ns]
    block: Block
    buffer: Buffer  #: with which it was sent last
    near: Block  #: its spool cells and those of its buffer, as wide as it has ever been
    n_sent: int = -1  #: points near it when it was sent last; −1 = never
    n_points: int = -1  #: points that it was sent with last, its buffer's too; −1 = none of use
    revision: int = -1  #: number of the last one that was sent; −1 = none was


class LiveSurvey:
    """
    Takes placed scans, and gives out tiles.

    A tile is ready when no point has fallen into it or its buffer for a while. It comes again as a later
    revision, with all its points and the first buffer, when more have come. Every point goes to disk at once;
    memory holds a batch. What comes out depends on the points and their order alone, not on when tiles were
    left or sent. Of what was seen from the street, and of tiles with many points, those near others are left
    out, and all of full ones.

    A feed that was cut off goes on with the points that its folder holds. `spacing` is what tiles are
    expected to have [m]; each has its own if it is not given. `left_out` leads from a reason to the points
    that were left out; `places` has what a vehicle has just seen. OutputError if the folder cannot be used.
    """

    def __init__(
        self, config: LiveTilingConfig, frame: MapFrame, folder: Path, spacing: float | None = None
    ) -> None:
        self.config, self.frame, self._spacing = config, frame, spacing
        self._buffer = Buffer.of(config.buffer)
        self.left_out: Counter[str] = Counter()
        self._n_from_street = 0  # points that came
        self._grid = TileGrid.fitting(config.tile_size, config.buffer / _CELLS_PER_BUFFER)
        self._log, self._cells = PointLog(folder), folder / "cells"
        shutil.rmtree(self._cells, ignore_errors=True)
        self._lock = threading.RLock()
        self._begin()
        for records in self._log.blocks():
            self._keep(records, -math.inf)
        self._n_chosen.update(
            {place: self._store.count_in(tile.block.cells) for place, tile in self._tiles.items()}
        )
        self._resume({tuple(event["tile"]): event for event in self._log.events()})

    def _begin(self) -> None:
        self._cells.mkdir(exist_ok=True)
        self._store = TileStore(self._grid, self.frame, self._cells, self._spacing, self.config.given_view)
        self._tiles: dict[Cell, LiveTile] = {}
        self._by_stamp: dict[int, LiveTile] = {}
        #: When a point fell into each cell last, and the widest buffer that a tile has had [m].
        self._touched = CellTable(-math.inf)
        self._widest = max(self._buffer)
        #: Tiles that have seen points since they were looked at; that wait to be sent or to be done; and that
        #: wait to be sent.
        self._changed: set[Cell] = set()
        self._under_way: set[Cell] = set()
        self._ready: list[Cell] = []
        #: Tiles that a flush wants sent, and those that it has sent or found under way.
        self._to_flush, self._in_flush = set[Cell](), set[Cell]()
        self._batch: list[PlacedScan] = []
        self.places = RoadPlaces(self.config.road_place, self.frame)
        #: Points seen from above in tiles that were sent before, until they are taken.
        self.newer: deque[NDArray[Any]] = deque(maxlen=_MOST_NEWER)
        #: What is kept of scans and could not be written yet.
        self._unwritten: list[NDArray[Any]] = []
        self._n_chosen: Counter[Cell] = Counter()  # points of each tile, those included
        self._arrived = -math.inf
        self._seen_voxels = SeenVoxels()

    @property
    def n_tiles(self) -> int:
        """Tiles that have points."""
        return len(self._tiles)

    @property
    def n_points(self) -> int:
        """Points that were kept."""
        return self._log.count

    @property
    def n_waiting(self) -> int:
        """Tiles, roughly, with points that are not sent, or not done; 0 if there is none."""
        return len(self._changed) + len(self._under_way) + bool(self._batch or self._unwritten)

    @property
    def n_left(self) -> int:
        """Tiles, roughly, with points that are not sent; 0 if there is none."""
        return len(self._changed) + len(self._ready) + bool(self._batch or self._unwritten)

    @property
    def thinned(self) -> str:
        """How many of the points from the street were left out, and by which rule; empty if none came."""
        why = THINNED.format(self.config.street_voxel)
        n = self._n_from_street
        return f"{self.left_out[why]:,} of {n:,} points are left out: {why}" if n else ""

    def add(self, scan: PlacedScan, now: float) -> None:
        """Take a scan in the map at a time [s]; OutputError if the disk is full: the next call writes it."""
        if not (held := are_held(scan.points)).all():
            self.left_out[BEYOND] += int(np.count_nonzero(~held))
            columns = {name: values[held] for name, values in scan.columns.items()}
            scan = PlacedScan(scan.points[held], scan.times[held], columns, scan.way)
        with self._lock:
            self._batch.append(scan)
            self._arrived = now
            if sum(len(one.points) for one in self._batch) >= _BATCH:
                self._keep_batch()

    @property
    def is_flushed(self) -> bool:
        """Whether what the last `flush` wanted is done."""
        return not (self._to_flush or self._in_flush)

    def flush(self) -> None:
        """Have all tiles sent that have new points; errors as of `add`."""
        with self._lock:
            self._keep_batch()
            self._drop_unchanged()
            self._to_flush = set(self._changed)
            self._in_flush = self._under_way - self._to_flush

    def tick(self, now: float) -> bool:
        """Make the tiles ready that were left; return whether any is. Errors as of `add`."""
        with self._lock:
            self._keep_batch()
            if now - self._arrived > _SILENCE:
                self.places.end()
            self._drop_unchanged()
            for place in sorted(self._changed - self._under_way):
                if place in self._to_flush or self._is_due(self._tiles[place], now):
                    self._in_flush |= self._to_flush & {place}
                    self._to_flush.discard(place)
                    self._changed.discard(place)
                    self._under_way.add(place)
                    self._ready.append(place)
            return bool(self._ready)

    def take(self) -> PointTile | None:
        """
        Return the ready tile into which no point has fallen for longest, None if none is ready.

        Those without gaps go first, then those with gaps in their buffer: the others most often come again.
        One near which points fell, but none into it or its buffer, has nothing new and is done. Raises an
        OutputError if the disk is full; the tile stays ready.
        """
        while True:
            with self._lock:
                if not self._ready:
                    return None
                tile = self._tiles[min(self._ready, key=self._turn)]
                made = self._spooled(tile, tile.revision + 1).read()
                is_new = len(made) != tile.n_points
                if is_new and tile.buffer != self._buffer:  # else what it grew for earlier would tell
                    tile.buffer = self._buffer
                    made = self._spooled(tile, tile.revision + 1).read()
                self._note(tile, tile.revision + is_new, -1)
                self._ready.remove(tile.place)
                tile.revision += is_new
                tile.n_sent, tile.n_points = self._n_near(tile), len(made)
                if is_new:
                    return made
                self.finish(tile.stamp + tile.revision)

    def grown(self, sent: PointTile, sides: Sides = ALL) -> PointTile | None:
        """Return the tile once more, its buffer doubled on some sides; None if there is no more."""
        with self._lock:
            if (tile := self._by_stamp.get(tile_of(sent.stamp))) is None:
                return None
            spooled, most = self._spooled(tile, tile.revision), self.config.max_buffer
            is_more = spooled.grow(sides)
            # what comes there later counts, too, where there is nothing now
            self._widen(tile, spooled.buffer if is_more else tile.buffer.doubled(sides, most, most))
            if not is_more:
                return None
            made = spooled.read()
            self._note(tile, tile.revision + 1, -1)
            tile.revision, tile.n_points = tile.revision + 1, len(made)
            return made

    def finish(self, stamp: int, *, is_done: bool = True) -> None:
        """Note that a tile is done, or was given up: it may come again. OutputError if the disk is full."""
        with self._lock:
            if (tile := self._by_stamp.get(tile_of(stamp))) is None:
                return
            # a writer that was started anew tells once more of what was done before
            is_last = stamp - tile.stamp >= tile.revision and tile.place not in self._ready
            tile.revision = max(tile.revision, stamp - tile.stamp)
            if not is_last:
                return
            self._under_way.discard(tile.place)
            self._in_flush.discard(tile.place)
            if not is_done:
                tile.n_points = -1
            self._note(tile, tile.revision, tile.n_sent if is_done else -1)

    def records(self, number: int) -> Iterable[NDArray[Any]]:
        """Read the points of file `number`, see `POINTS_PER_FILE`, some at a time."""
        return self._log.blocks(number * POINTS_PER_FILE, (number + 1) * POINTS_PER_FILE)

    def clear(self) -> None:
        """Forget all points and tiles."""
        with self._lock:
            self._log.clear()
            self._store.spool.remove()
            self._begin()

    def close(self) -> None:
        """Write what is in memory, and delete what can be made again."""
        with self._lock:
            try:
                self._keep_batch()
            finally:
                shutil.rmtree(self._cells, ignore_errors=True)

    # tiles

    def _resume(self, last: dict[Cell, dict[str, Any]]) -> None:
        """Give tiles the stamps and revisions that they had in an earlier life."""
        for place in last.keys() & self._tiles.keys():
            tile, event = self._tiles[place], last[place]
            tile.stamp, tile.revision, tile.n_sent = event["stamp"], event["revision"], event["n_done"]
        self._by_stamp.clear()
        for tile in sorted(self._tiles.values(), key=lambda one: (one.revision < 0, one.place)):
            tile.stamp = self._free(tile.stamp)
            self._by_stamp[tile.stamp] = tile

    def _free(self, stamp: int) -> int:
        while stamp in self._by_stamp:
            stamp += STEP
        return stamp

    def _block_near(self, block: Block, buffer: Buffer) -> Block:
        return self._grid.block_in(self._grid.area_of(block).buffered(buffer))

    def _n_near(self, tile: LiveTile) -> int:
        return self._store.count_in(tile.near.cells)

    def _widen(self, tile: LiveTile, buffer: Buffer) -> None:
        """Have points count for a tile that fall into a wider buffer, as it was made with that."""
        n_before = self._n_near(tile)
        tile.buffer = buffer
        tile.near = Block.around([tile.near, self._block_near(tile.block, buffer)])
        tile.n_sent += self._n_near(tile) - n_before
        self._widest = max(self._widest, *buffer)

    def _turn(self, place: Cell) -> tuple[bool, bool, float]:
        """Order ready tiles: cells that have had no point may be filled by later passes."""
        tile = self._tiles[place]
        own, near = ([self._touched[cell] for cell in one.cells] for one in (tile.block, tile.near))
        return -math.inf in own, -math.inf in near, max(near)

    def _is_due(self, tile: LiveTile, now: float) -> bool:
        """Whether no point has fallen into a tile or its buffer for long enough: longer with few new ones."""
        share_new = 1.0 - max(tile.n_sent, 0) / max(self._n_near(tile), 1)
        since = now - max(self._touched[cell] for cell in tile.near.cells)
        return since * min(share_new / _FEW, 1.0) >= self.config.leave_after

    def _note(self, tile: LiveTile, revision: int, n_done: int) -> None:
        """Note which revision was sent or done last, for the next life: it must send a later one."""
        self._log.note({"tile": tile.place, "stamp": tile.stamp, "revision": revision, "n_done": n_done})

    def _drop_unchanged(self) -> None:
        """Forget that tiles were touched which have no points that were not sent, or came too often."""
        for place in self._changed - self._under_way:
            tile = self._tiles[place]
            if self._n_near(tile) == tile.n_sent or tile.revision >= MOST_REVISIONS:
                self._changed.discard(place)
                self._to_flush.discard(place)

    def _spooled(self, tile: LiveTile, revision: int) -> SpooledTile:
        core = {cell: (0, count) for cell in tile.block.cells if (count := self._store.count_in([cell]))}
        stamp, most = tile.stamp + revision, self.config.max_buffer
        return SpooledTile(self._store, stamp, tile.block, core, tile.buffer, most)

    # points

    def _keep_batch(self) -> None:
        """Write what has come; what is left out of it is chosen once, however often writing is tried."""
        if self._batch:
            chosen = [self._chosen(records_of(scan)) for scan in self._batch]
            for kept, scan in zip(chosen, self._batch, strict=True):
                self.places.add(kept.compress(self._are_from_street(kept)), scan.way)
            self._unwritten.append(np.concatenate(chosen))
            self._batch.clear()
        while self._unwritten:
            kept = self._unwritten[0]
            numbers = np.arange(self._log.count, self._log.count + len(kept))
            kept["source"], kept["index"] = np.divmod(numbers, POINTS_PER_FILE)
            self._log.append(kept)
            try:
                self._keep(kept, self._arrived)
            except Exception:
                self._log.take_back(len(kept))
                raise
            self._unwritten.pop(0)

    def _chosen(self, records: NDArray[Any]) -> NDArray[Any]:
        """Leave out points: from the street, and in crowded tiles, those near others; in full ones all."""
        if voxel := self.config.street_voxel:
            is_street = self._are_from_street(records)
            self._n_from_street += int(np.count_nonzero(is_street))
            is_kept = self._are_kept(records, is_street, voxel, THINNED.format(voxel))
            records = records.compress(is_kept)
        columns_rows = self._cells_of(records) // self._grid.cells_per_side
        _, first, tile = np.unique(columns_rows @ _KEY, return_index=True, return_inverse=True)
        places = [(column, row) for column, row in columns_rows[first].tolist()]
        counts = np.array([self._n_chosen[place] for place in places], dtype=np.int64)[tile]
        is_kept = counts < self.config.max_tile_points
        n_full = len(records) - int(np.count_nonzero(is_kept))
        self.left_out.update({TOO_MANY: n_full} if n_full else {})
        records, tile, counts = records.compress(is_kept), tile[is_kept], counts[is_kept]
        is_crowded = counts >= _CROWDED * self.config.max_tile_points
        if voxel:
            is_crowded &= ~self._are_from_street(records)
        is_kept = self._are_kept(records, is_crowded, VOXEL, CROWDED)
        n_of_tile = np.bincount(tile[is_kept], minlength=len(places))
        self._n_chosen.update(dict(zip(places, n_of_tile.tolist(), strict=True)))
        return records.compress(is_kept)

    def _are_kept(
        self, records: NDArray[Any], is_thinned: NDArray[np.bool_], side: float, why: str
    ) -> NDArray[np.bool_]:
        """Tell which records stay if of some those near others are left out, and count the others."""
        is_kept, rows = ~is_thinned, np.flatnonzero(is_thinned)
        points = np.stack([records[axis][rows] for axis in "xyz"], axis=1).astype(np.float64)
        is_kept[rows] = self._seen_voxels.are_new(points, side)
        n_left_out = len(rows) - int(np.count_nonzero(is_kept[rows]))
        self.left_out.update({why: n_left_out} if n_left_out else {})
        return is_kept

    def _are_from_street(self, records: NDArray[Any]) -> NDArray[np.bool_]:
        given = self.config.given_view
        return (records["view"] if given is View.UNKNOWN else np.full(len(records), given)) == View.STREET

    def _keep(self, records: NDArray[Any], now: float) -> None:
        cells = self._cells_of(records)
        touched = self._store.spool.append(cells, records)
        k, reach = self._grid.cells_per_side, math.ceil(self._widest / self._grid.cell_size) + 1
        for place in sorted({self._grid.tile_of(cell) for cell in touched} - self._tiles.keys()):
            row = np.flatnonzero((cells // k == place).all(axis=1))[0]
            gps_time, number = float(records["gps_time"][row]), len(self._tiles) + 1
            stamp = self._free(stamp_of_time(gps_time, is_standard=True) or stamp_of_number(number))
            block = self._grid.block_of(place)
            tile = LiveTile(place, stamp, block, self._buffer, self._block_near(block, self._buffer))
            self._tiles[place] = self._by_stamp[stamp] = tile
        if math.isfinite(now):
            places = {self._grid.tile_of(cell) for cell in touched}
            sent = [place for place in places if self._tiles[place].revision >= 0]
            is_sent = np.isin(cells // k @ _KEY, np.array(sent, dtype=np.int64).reshape(-1, 2) @ _KEY)
            is_sent &= ~self._are_from_street(records)
            if is_sent.any():
                self.newer.append(np.column_stack([records[axis][is_sent] for axis in "xyz"]))
        for cell in touched:
            self._touched[cell] = now
            columns, rows = (range((one - reach) // k, (one + reach) // k + 1) for one in cell)
            self._changed |= {(x, y) for x in columns for y in rows} & self._tiles.keys()

    def _cells_of(self, records: NDArray[Any]) -> NDArray[np.int64]:
        """Return the cells of records: by what is written, so that it is the same when it is read again."""
        x, y = (records[axis].astype(np.float64) + self.frame.origin[k] for k, axis in enumerate("xy"))
        return self._grid.cells_at(np.column_stack([x, y]))
