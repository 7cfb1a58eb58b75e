"""Node `tile_player`."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosgraph_msgs.msg import Clock

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags import bags_among
from lidar_buildings.io.bags.bag_inputs import place_bags, with_clouds
from lidar_buildings.io.clouds.input_file import InputFile
from lidar_buildings.io.tiling.spooled_tile import SpooledTile
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.nodes.configs import TilePlayerConfig
from lidar_buildings.nodes.tile_sender import TileSender
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.ros.qos import EVENT
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stamps import header_of, tile_of, to_time

#: Tiles read ahead: enough to read while one is sent, and no more memory.
_AHEAD = 1
#: Timeout of a wait for room in the queue, after which stopping is noticed [s].
_TRY = 0.1


class TileReader:
    """
    Reads the tiles of a source ahead, in a thread of its own: no callback waits for the disk.

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


class TilePlayer(TileSender):
    """Cuts files into tiles and sends them into the graph."""

    def __init__(self, pool: BuildingPool | None = None, *, keep: bool = False, **kwargs: Any) -> None:
        super().__init__("tile_player", TilePlayerConfig, **kwargs)
        config = self.parameters[TilePlayerConfig]
        self._temporary = TemporaryDirectory(prefix="lidar_buildings_", ignore_cleanup_errors=True)
        try:
            inputs = self._with_placed_bags(config)
            self._source = TileSource(inputs, config, skip=self._done, keep=keep, crs=config.crs)
        except Exception:
            self.destroy_node()
            raise
        for problem in self._source.problems:
            self.get_logger().error(problem)
        self.tiles = TileReader(self._source, pool or BuildingPool(0))
        self._clock_publisher = None
        if config.publish_clock:
            self._clock_publisher = self.create_publisher(Clock, "/clock", EVENT)
        self.begin()
        self.publish_frame(self._source.frame)
        self.tiles.start(lambda: self.errands.put(self.on_tick))

    @property
    def inputs(self) -> list[InputFile]:
        """The files that are read."""
        return self._source.inputs

    def may_send(self, tile: PointTile) -> bool:
        """Whether a tile's time has come in the recording."""
        return self._playback.is_due(tile.stamp, self.parameters[TilePlayerConfig].rate)

    def before(self, tile: PointTile) -> None:
        """Publish the time of a tile on request."""
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=to_time(max(tile.stamp, 0))))

    def on_all_done(self) -> None:
        """Say that the survey is done."""
        self._is_finished = True
        n_failed = f", {len(self._failed)} given up" if self._failed else ""
        self.get_logger().info(f"all tiles are done{n_failed}")
        self._survey_done.publish(header_of(max({*self._done, *self._failed}, default=0)))

    def destroy_node(self) -> None:
        """Stop reading and remove the temporary files."""
        if hasattr(self, "tiles"):
            self.tiles.stop()
            self._source.close()
        self._temporary.cleanup()
        super().destroy_node()

    def _with_placed_bags(self, config: TilePlayerConfig) -> tuple[str, ...]:
        """Return the inputs with clouds instead of bags, whose scans are placed now."""
        folder = Path(config.placed or self._temporary.name)
        if bags_among(config.input):
            self.get_logger().info("placing the scans of bags")
        records = place_bags(
            config.input, folder, config, self.parameters[ScanConfig], self.get_logger().info
        )
        for record in records:
            for problem in filter(None, [record["problem"], *record["warnings"]]):
                self.warn(f"{record['bag']}: {problem}")
        return with_clouds(config.input, folder)


def main() -> int:
    """Run the node."""
    return run_node(TilePlayer)
