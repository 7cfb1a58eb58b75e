"""Node `tile_player`."""

from __future__ import annotations

from typing import Any

from rosgraph_msgs.msg import Clock

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.nodes.configs import TilePlayerConfig
from lidar_buildings.nodes.tile_reader import TileReader
from lidar_buildings.nodes.tile_sender import TileSender
from lidar_buildings.ros.qos import EVENT
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stamps import header_of, to_time


class TilePlayer(TileSender):
    """Cuts files into tiles and sends them into the graph."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("tile_player", TilePlayerConfig, **kwargs)
        config = self.parameters[TilePlayerConfig]
        try:
            self._source = TileSource(config.input, config, skip=() if config.loop else self._done)
        except Exception:
            self.destroy_node()
            raise
        for problem in self._source.problems:
            self.get_logger().error(problem)
        self.tiles = TileReader(self._source, loop=config.loop)
        self._clock_publisher = None
        if config.publish_clock:
            self._clock_publisher = self.create_publisher(Clock, "/clock", EVENT)
        self.begin()
        self.publish_frame(self._source.frame)
        self.tiles.start(self._wake.trigger)

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
        super().destroy_node()


def main() -> int:
    """Run the node."""
    return run_node(TilePlayer)


if __name__ == "__main__":
    raise SystemExit(main())
