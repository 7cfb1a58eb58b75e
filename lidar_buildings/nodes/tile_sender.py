"""What every source of tiles does: few of them in the graph at a time, each until it is done."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any, ClassVar

from geometry_msgs.msg import PointStamped, Vector3Stamped
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.tiling.tile_queue import TileQueue
from lidar_buildings.nodes.configs import NODE_CONFIGS, SendingConfig
from lidar_buildings.nodes.map_frames import origin_message, units_message
from lidar_buildings.ros.flow_control import FlowControl
from lidar_buildings.ros.graph_watch import GraphWatch
from lidar_buildings.ros.letterbox import Letterbox
from lidar_buildings.ros.playback import Playback
from lidar_buildings.ros.qos import EVENT, LATCHED, LATCHED_EVENT, LATCHED_HISTORY, LATCHED_TILE
from lidar_buildings.ros.receipts import TOPIC as RECEIPTS
from lidar_buildings.ros.receipts import receipt_of
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import header_of, tile_of, to_stamp
from lidar_buildings.ros.tile_info import CLIPPED, clipped_of, info_message, over_message

#: Period of the checks of deadlines and subscribers, short against the time that a tile takes [s].
_TICK = 0.1
#: Period of the reminders of what is waited for [s].
_REMIND = 10.0


class TileSender(StageNode):
    """Base of the nodes that send tiles into the graph, as many at a time as there are credits."""

    #: Set by the subclass before it calls `begin`.
    tiles: TileQueue
    #: Whether scans come to it, of which none comes again.
    carries_scans: ClassVar[bool] = False

    def __init__(self, name: str, config: type[SendingConfig], **kwargs: Any) -> None:
        super().__init__(name, NODE_CONFIGS[name], **kwargs)
        sending = self.sending = self.parameters[config]
        # by ticks, so that silence is what the node has listened to, not what it was too busy to hear
        self._time = 0.0
        self._flow = FlowControl(
            sending.max_tiles_in_flight, sending.tile_timeout, sending.max_attempts, lambda: self._time
        )
        self.summary.watch(self._flow.gauges)
        self._watch = GraphWatch(self)
        #: Tile → the last revision of it that is done; tiles that were given up, or sent again.
        self._done: dict[int, int] = {}
        self._failed: set[int] = set()
        self._resent: set[int] = set()
        self._playback = Playback(is_paused=sending.start_paused)
        self._next: PointTile | None = None

    @classmethod
    def main(cls) -> int:
        """Run the node as a process of its own."""
        return run_node(cls, carries_scans=cls.carries_scans)

    def begin(self) -> None:
        """Make publishers, services and subscriptions, and send what is due from now on."""
        self._points = self.create_tile_outlet("points")
        self._info = self.create_publisher(String, "tile_info", LATCHED_TILE)
        self._survey_done = self.create_publisher(Header, "survey_done", LATCHED)
        self._tile_failed = self.create_publisher(Header, "tile_failed", LATCHED_HISTORY)
        self._map_units = self.create_publisher(Vector3Stamped, "map_units", LATCHED)
        self._map_origin = self.create_publisher(PointStamped, "map_origin", LATCHED)
        self.create_service(Trigger, "~/pause", self.on_pause)
        self.create_service(Trigger, "~/resume", self.on_resume)
        self.create_service(Trigger, "~/step", self.on_step)
        self.create_subscription(String, CLIPPED, self.on_clipped, EVENT)
        self._receipt_box = Letterbox(self, String, RECEIPTS, self.on_receipt, LATCHED_EVENT)
        self.create_subscription(Header, "tile_done", self.on_done, LATCHED_HISTORY)
        self.create_timer(_TICK, self.on_timer)

    def publish_frame(self, frame: MapFrame) -> None:
        """Publish where the map frame lies."""
        self._map_units.publish(units_message(frame))
        self._map_origin.publish(origin_message(frame))

    def may_send(self, tile: PointTile) -> bool:
        """Whether a tile's time has come, all else being there; pause and step say so."""
        return self._playback.is_due(tile.stamp, 0.0)

    @property
    def n_done(self) -> int:
        """Number of tiles that are done."""
        return len(self._done)

    def on_timer(self) -> None:
        """Let time go on, and send what is due."""
        self._time += _TICK
        self.on_tick()

    def on_tick(self) -> None:
        """Send what is due."""
        if self.tiles.error is not None:
            self.fail(self.tiles.error)
            return
        self._receipt_box.look()
        self._send_overdue()
        while (tile := self._next_to_send()) is not None:
            self._send(tile)

    def on_done(self, message: Header) -> None:
        """Take back a tile's credit; an earlier revision than the one under way is none."""
        self._receipt_box.look()
        stamp = to_stamp(message.stamp)
        sent = self._flow.tile(stamp)
        if sent is not None and stamp < sent.stamp:
            return
        self.note_done(stamp)
        if sent is not None and self._flow.done(stamp):
            self._call_off(sent.stamp)
            self.on_tick()

    def note_done(self, stamp: int) -> None:
        """Note that a revision of a tile is done."""
        self._done[tile_of(stamp)] = max(stamp, self._done.get(tile_of(stamp), 0))
        self._failed.discard(tile_of(stamp))

    def note_failed(self, stamp: int) -> None:
        """Note that a tile was given up."""
        self._failed.add(tile_of(stamp))

    def forget_tiles(self) -> None:
        """Forget all tiles, and have the copies of those dropped that are under way."""
        for stamp in self._flow.forget():
            self._info.publish(over_message(stamp))
        self._done.clear()
        self._failed.clear()
        self._resent.clear()
        self._next = None

    def on_receipt(self, message: String) -> None:
        """Note what a node has in hand."""
        receipt = receipt_of(message)
        if self._watch.hear(receipt):
            self._flow.started(receipt.node)
        if not self._watch.is_past(receipt):
            self._flow.hear(receipt)

    def on_clipped(self, message: String) -> None:
        """
        Send the next revision of a tile, with a larger buffer; only say so if there is nothing more to send.
        """
        stamp, sides = clipped_of(message)
        tile = self._flow.tile(stamp)
        if tile is None or tile.stamp != stamp:
            return  # of an earlier revision
        with self.reporting(tile.stamp, quiet=True):
            grown = self.tiles.grown(tile, sides)
            if grown is not None:
                grown = replace(grown, stamp=tile.stamp + 1)
                self._info.publish(over_message(tile.stamp))
                self._publish(grown)
            else:
                grown = replace(tile, bounds=sides.opened(tile.bounds))
                self._info.publish(info_message(grown))
            self._flow.sent(grown)

    def on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Send no more tiles."""
        self._playback.pause()
        response.success, response.message = True, "paused"
        return response

    def on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Go on."""
        self._playback.resume()
        response.success, response.message = True, "playing"
        return response

    def on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Send one tile while paused."""
        response.success = self._playback.step()
        response.message = "one tile will be sent" if response.success else "not paused: call pause first"
        return response

    def _next_to_send(self) -> PointTile | None:
        """Return the next tile if there is a credit for it, someone to take it, and its time has come."""
        tile = self._peek() if self._flow.has_room else None
        if tile is None or not self.may_send(tile) or not self._has_listeners():
            return None
        self._next = None
        self._playback.sent()
        return tile

    def _peek(self) -> PointTile | None:
        """Return the next tile that is not done yet, None if none is ready."""
        while self._next is None or self._next.stamp <= self._done.get(tile_of(self._next.stamp), -1):
            self._next = self.tiles.take()
            if self._next is None:
                return None
        return self._next

    def _has_listeners(self) -> bool:
        """
        Whether topics have their subscribers, nodes that share tiles are all there, and one ends tiles.

        They know of each other, too.
        """
        wanted = Counter(self.sending.wait_for)
        missing = [topic for topic, n in wanted.items() if self.count_subscribers(topic) < n]
        what = f"a subscriber of {', '.join(missing)}"
        if not missing and self._flow.is_counting and not self.count_publishers("tile_done"):
            missing, what = ["tile_done"], "a publisher of tile_done (model_writer, or model_builder)"
        if not missing and (missing := self._watch.missing_replicas()):
            what = f"{', '.join(missing)}: all share the tiles"
        if missing:
            self.get_logger().info(f"waiting for {what}", throttle_duration_sec=_REMIND, skip_first=True)
        return not missing and self._watch.is_settled

    def _send(self, tile: PointTile) -> None:
        """
        Send a tile for the first time; what a node has from this one's life before is only told of again.
        """
        if self._flow.is_held(tile.stamp):
            self._info.publish(info_message(tile))
        else:
            self._publish(tile)
        self._flow.sent(tile)
        if not self._flow.is_counting:
            self.note_done(tile.stamp)

    def _publish(self, tile: PointTile) -> None:
        """Publish what holds for a tile as a whole, and its points."""
        with self.reporting(tile.stamp) as report:
            report.n_points = len(tile)
            self.before(tile)
            self._info.publish(info_message(tile))
            self._points.publish(tile.stamp, tile)

    def before(self, tile: PointTile) -> None:
        """Do what comes before a tile's points; nothing if not said otherwise."""

    def _send_overdue(self) -> None:
        """Send again what is lost as soon as the nodes are there, and give up what was lost too often."""
        if self._flow.has_losses and self._has_listeners():
            for flight in self._flow.overdue():
                stamp = flight.tile.stamp
                self.warn(f"tile {stamp} was lost: sent again ({flight.attempt})")
                self._resent.add(tile_of(stamp))
                self._publish(flight.tile)
        for stamp in self._flow.given_up():
            self.get_logger().error(f"tile {stamp} was never done: given up")
            self.summary.failed(f"tile {stamp} was never done: given up")
            self.note_failed(stamp)
            self._tile_failed.publish(header_of(stamp))
            self._call_off(stamp)

    def _call_off(self, stamp: int) -> None:
        """Have the copies of a tile dropped that may still be under way."""
        if tile_of(stamp) in self._resent:
            self._info.publish(over_message(stamp))
