"""Node `tile_player`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from rosgraph_msgs.msg import Clock

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags.bag_inputs import bags_among, place_bags, with_clouds
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.files.temporary_folder import make_temporary_folder, remove_folder
from lidar_buildings.io.tiling.tile_store import SpooledTile
from lidar_buildings.io.tiling.tiling import FileQueue, TileSource
from lidar_buildings.nodes.configs import TilePlayerConfig
from lidar_buildings.nodes.tile_sender import TileSender
from lidar_buildings.ros.qos import EVENT
from lidar_buildings.ros.stamps import to_time


class TilePlayer(TileSender):
    """Cuts files into tiles and sends them into the graph."""

    def __init__(self, *, keep: bool = False, **kwargs: Any) -> None:
        super().__init__("tile_player", TilePlayerConfig, **kwargs)
        config = self.parameters[TilePlayerConfig]
        self._temporary: Path | None = None
        with self.starting():
            inputs = self._with_placed_bags(config)
            self._source = TileSource(inputs, config, skip=self._ledger.finished, keep=keep, crs=config.crs)
        for problem in self._source.problems:
            self.get_logger().error(problem)
        self.tiles = FileQueue(self._source, self._read)
        self._is_finished = False
        self._clock_publisher = (
            self.create_publisher(Clock, "/clock", EVENT) if config.publish_clock else None
        )
        self.begin()
        self.publish_frame(self._source.frame)

    @property
    def inputs(self) -> list[InputFile]:
        """The files that are read."""
        return self._source.inputs

    def is_due(self, stamp: int) -> bool:
        """Whether a tile's time has come at `rate` times the recorded speed; 0 means at once."""
        rate = self.parameters[TilePlayerConfig].rate
        if self._is_paused or not rate:
            return True
        self._first = self._first or (stamp, time.monotonic())
        return time.monotonic() - self._first[1] >= (stamp - self._first[0]) * 1e-9 / rate

    def before(self, tile: PointTile) -> None:
        """Publish the time of a tile on request."""
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=to_time(max(tile.stamp, 0))))

    def on_tick(self) -> None:
        """Send what is due; when no tile is left to send or to wait for, say that the survey is done."""
        if self._is_finished:
            return
        super().on_tick()
        if self.is_empty:
            self._is_finished = True
            n_failed = f", {len(self._ledger.failed)} given up" if self._ledger.failed else ""
            self.get_logger().info(f"all tiles are done{n_failed}")
            self.tell_survey_done()

    def destroy_node(self) -> None:
        """Stop reading and remove the temporary files."""
        if hasattr(self, "tiles"):
            self.tiles.stop()
        if self._temporary is not None:
            remove_folder(self._temporary)
        super().destroy_node()

    def _read(self, tile: SpooledTile) -> PointTile:
        """Put a tile together, in a process of the pool where there is one; in the queue's thread."""
        return tile.read() if self.pool is None else self.pool.submit(SpooledTile.read, tile).result()

    def _with_placed_bags(self, config: TilePlayerConfig) -> tuple[str, ...]:
        """Return the inputs with clouds instead of bags, whose scans are placed now."""
        if not bags_among(config.input):
            return config.input
        if not config.placed:
            self._temporary = make_temporary_folder()
        folder = self._temporary or Path(config.placed)
        log = self.get_logger().info
        log("placing the scans of bags")
        for record in place_bags(config.input, folder, config, self.parameters[ScanConfig], log):
            for warning in record["warnings"]:
                self.warn(f"{record['bag']}: {warning}")
        return with_clouds(config.input, folder)
