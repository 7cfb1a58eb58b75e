"""What every source of tiles does: few of them in the graph at a time, each until it is done."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import Future
from dataclasses import replace
from typing import Any
from uuid import uuid4

from geometry_msgs.msg import PointStamped, Vector3Stamped
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.tiling.live_feed import LiveFeed
from lidar_buildings.io.tiling.tiling import FileQueue
from lidar_buildings.nodes.configs import NODE_CONFIGS, SendingConfig
from lidar_buildings.nodes.map_frames import origin_message, units_message
from lidar_buildings.ros.depths import CLOUD_DEPTH
from lidar_buildings.ros.diagnostics import TileReport
from lidar_buildings.ros.node_state import TOPIC as NODE_STATE
from lidar_buildings.ros.node_state import state_of
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import CLOUD, LATCHED, LATCHED_EVENT, LATCHED_HISTORY, SILENT_SUBSCRIPTION
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import header_of, to_stamp
from lidar_buildings.ros.tile_info import TOPIC as TILE_INFO
from lidar_buildings.ros.tile_info import info_message
from lidar_buildings.ros.tile_ledger import TileLedger

#: Period of the checks of tiles and subscribers, short against the time that a tile takes; of looking up the
#: graph's nodes, which takes long; and of the reminders of what is waited for [s].
_TICK, _LOOK, _REMIND = 0.1, 0.5, 10.0


class TileSender(StageNode):
    """Base of the nodes that send tiles into the graph, as many at a time as there are credits."""

    #: Set by the subclass before it calls `begin`.
    tiles: FileQueue | LiveFeed

    def __init__(self, name: str, config: type[SendingConfig], **kwargs: Any) -> None:
        super().__init__(name, NODE_CONFIGS[name], **kwargs)
        sending = self.sending = self.parameters[config]
        # by ticks, so that time passes only while the node listens
        self._time = 0.0
        self._ledger = TileLedger(
            sending.max_tiles_in_flight, sending.tile_timeout, sending.max_attempts, lambda: self._time
        )
        self.summary.gauges.append(self._ledger.gauges)
        self._life = uuid4().hex if self._ledger.limit else ""
        #: Tiles whose larger revision is being read; those sent last, where none is waited for.
        self._growing: set[int] = set()
        self._uncounted: list[PointTile] = []
        self._seen: set[str] = set()  # nodes in the graph
        self._looked = -_LOOK
        self._is_paused, self._steps = sending.start_paused, 0
        #: First tile of a recording since the start or a pause, and when it was due [s].
        self._first: tuple[int, float] | None = None
        self._next: PointTile | None = None

    def begin(self) -> None:
        """Make publishers, services and subscriptions, and send what is due from now on."""
        self._points = self.create_output(PointCloud2, "points", CLOUD)
        self._info = self.create_publisher(String, TILE_INFO, LATCHED)
        self._survey_done = self.create_publisher(Header, "survey_done", LATCHED)
        self._tile_failed = self.create_publisher(Header, "tile_failed", LATCHED_HISTORY)
        self._map_units = self.create_publisher(Vector3Stamped, "map_units", LATCHED)
        self._map_origin = self.create_publisher(PointStamped, "map_origin", LATCHED)
        for name, callback in (("pause", self.on_pause), ("resume", self.on_resume), ("step", self.on_step)):
            self.create_service(Trigger, f"~/{name}", callback)
        self.create_subscription(
            String, NODE_STATE, self.on_state, LATCHED_EVENT, event_callbacks=SILENT_SUBSCRIPTION
        )
        self.create_subscription(Header, "tile_done", self.on_done, LATCHED_HISTORY)
        self.create_timer(_TICK, self.on_timer)
        self.tiles.start(lambda: self.call_soon(self.on_tick))

    def publish_frame(self, frame: MapFrame) -> None:
        """Publish where the map frame lies."""
        self._map_units.publish(units_message(frame))
        self._map_origin.publish(origin_message(frame))

    @property
    def n_done(self) -> int:
        """Number of tiles that are done."""
        return len(self._ledger.finished)

    @property
    def is_empty(self) -> bool:
        """Whether no tile is in flight, waiting or spooled."""
        return not (len(self._ledger) or self._peek() is not None or self.tiles.n_left)

    # what is heard

    def on_timer(self) -> None:
        """Let time go on, look who is there, and send what is due."""
        self._time += _TICK
        if self._time - self._looked >= _LOOK:
            self._look_around()
        self.on_tick()

    def on_tick(self) -> None:
        """Send what is due."""
        if self.tiles.error is not None:
            self.fail(self.tiles.error)
            return
        self._give_up()
        for tile, sides in self._ledger.wanted():
            self._grow(tile, sides)
        while self._may_send():
            self._send(self._next)

    def on_state(self, message: String) -> None:
        """Note what a node has of each tile."""
        self._ledger.hear(state_of(message))
        if any(self._ledger.wanted()):
            self.on_tick()

    def on_done(self, message: Header) -> None:
        """Take back a tile's credit; an earlier revision than the one under way is none."""
        stamp, n_before = to_stamp(message.stamp), len(self._ledger)
        if self._ledger.done(stamp):
            self.on_end(stamp)
        if len(self._ledger) < n_before:
            self._tell()
            self.on_tick()

    def on_end(self, stamp: int, *, is_done: bool = True) -> None:
        """Do what follows the end of a tile, which is done or was given up."""

    def tell_survey_done(self) -> None:
        """Say that every tile is done or given up."""
        self._survey_done.publish(header_of(max({*self._ledger.finished, *self._ledger.failed}, default=0)))

    def forget_tiles(self) -> None:
        """Forget all tiles, and have the copies of those dropped that are under way."""
        self._ledger.forget()
        self._tell()
        self._next = None

    def on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Send no more tiles."""
        self._is_paused = True
        response.success, response.message = True, "paused"
        return response

    def on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Go on."""
        self._is_paused, self._steps, self._first = False, 0, None
        response.success, response.message = True, "playing"
        return response

    def on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Send one tile while paused."""
        self._steps += self._is_paused
        response.success = self._is_paused
        response.message = "one tile will be sent" if self._is_paused else "not paused: call pause first"
        return response

    # what is sent

    def is_due(self, stamp: int) -> bool:
        """Whether a tile's time has come."""
        return True

    def _may_send(self) -> bool:
        """Whether a tile is there, its time has come, there is a credit for it, and someone to take it."""
        if not self._ledger.has_room or (self._is_paused and not self._steps):
            return False
        tile = self._peek()
        return tile is not None and self.is_due(tile.stamp) and self._has_listeners()

    def _peek(self) -> PointTile | None:
        """Return the next tile that is not done yet, None if none is ready."""
        while self._next is None or self._ledger.is_done(self._next.stamp):
            self._next = self.tiles.take()
            if self._next is None:
                return None
        return self._next

    def _look_around(self) -> None:
        """See which nodes are in the graph, and send again what is lost."""
        self._looked = self._time
        self._seen = {
            one.node_name
            for one in self.get_publishers_info_by_topic(NODE_STATE)
            if one.node_namespace == self.get_namespace() and one.node_name != "_NODE_NAME_UNKNOWN_"
        }
        self._ledger.see(self._seen)
        if len(self._ledger) and self._has_listeners():
            for flight in self._ledger.lost():
                # one of which the nodes know other bounds is a new revision
                tile = replace(flight.tile, stamp=flight.tile.stamp + flight.is_adopted)
                self.warn(f"tile {tile.stamp} is lost: sending it again ({flight.n_resent})")
                self._publish(tile)

    def _has_listeners(self) -> bool:
        """Whether topics have subscribers, replicas are all there, one node ends tiles, and all have met."""
        wanted = Counter(self.sending.wait_for)
        what = ""
        if missing := [topic for topic, n in wanted.items() if self.count_subscribers(topic) < n]:
            what = f"a subscriber of {', '.join(missing)}"
        elif self._ledger.limit and not self.count_publishers("tile_done"):
            what = "a publisher of tile_done (model_writer, or model_builder)"
        elif missing := self._ledger.missing_replicas():
            what = f"{', '.join(missing)} (all replicas share the tiles)"
        if what:
            self.get_logger().info(f"waiting for {what}", throttle_duration_sec=_REMIND, skip_first=True)
            return False
        # before the first look nobody is known, and what nodes have from an earlier life would come again
        return bool(self._seen) and self._ledger.is_settled(self._seen, self.count_subscribers)

    def _send(self, tile: PointTile) -> None:
        """Send a tile for the first time; what nodes have from this one's life before is listed alone."""
        self._next, self._steps = None, max(0, self._steps - 1)
        latest = self._ledger.latest(tile.stamp) if self._ledger.limit else None
        if latest is not None and latest >= tile.stamp:
            self._ledger.sent(replace(tile, stamp=latest), is_adopted=True)
            self._tell()
            return
        self._publish(tile)
        if not self._ledger.limit and self._ledger.done(tile.stamp):
            self.on_end(tile.stamp)

    def _publish(self, tile: PointTile) -> None:
        """List a tile, and publish its points."""
        report = TileReport(tile.stamp, len(tile))
        self.summary.taken()
        self.before(tile)
        self._ledger.sent(tile)
        if not self._ledger.limit:
            self._uncounted = [*self._uncounted[1 - CLOUD_DEPTH :], tile]
        self._tell()
        self._points.publish(to_message(tile))
        self._ledger.sent(tile)  # publishing takes its time
        self.summary.passed_on(len(tile))
        self._diagnostics.end_tile(report)

    def _tell(self) -> None:
        """Publish which tiles are in flight."""
        listed = self._uncounted or self._ledger.listed()
        adopted = (one.stamp for one in self._ledger.listed(is_adopted=True))
        self._info.publish(info_message(*listed, adopted=adopted, life=self._life))

    def before(self, tile: PointTile) -> None:
        """Do what comes before a tile's points; nothing if not said otherwise."""

    def _grow(self, tile: PointTile, sides: Sides) -> None:
        """Read a tile with a larger buffer, beside the executor."""
        if tile.stamp not in self._growing:
            self._growing.add(tile.stamp)
            work = self.submit_here(self.tiles.grown, tile, sides)
            self.when_done(work, lambda work: self._grown(tile, sides, work))

    def _grown(self, tile: PointTile, sides: Sides, work: Future[PointTile | None]) -> None:
        """Send the next revision of a tile; only say so if there is nothing more to send."""
        self._growing.discard(tile.stamp)
        now = self._ledger.tile(tile.stamp)
        if now is None or now.stamp != tile.stamp or work.cancelled():
            return
        if (error := work.exception()) is not None:
            self.fail(error)
        elif (grown := work.result()) is not None:
            self._publish(replace(grown, stamp=tile.stamp + 1))
        else:
            self._ledger.sent(replace(now, bounds=sides.opened(now.bounds)))
            self._tell()

    def _give_up(self) -> None:
        """Give up what a node cannot handle."""
        given_up = self._ledger.given_up()
        for stamp, reason in given_up.items():
            text = f"tile {stamp} is given up: {reason}"
            self.get_logger().error(text)
            self.summary.failed(text)
            self.on_end(stamp, is_done=False)
            self._tile_failed.publish(header_of(stamp))
        if given_up:
            self._tell()
