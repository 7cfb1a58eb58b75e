"""Quality of service: some kinds of topic, one profile each; and who says where profiles do not match."""

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from lidar_buildings.ros import depths


def _profile(depth: int, *, latched: bool = False) -> QoSProfile:
    """Return a reliable profile that keeps the last messages, with `latched` for late joiners as well."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
    )


#: One message per tile. The credits of the player bound what is under way, so nothing is overwritten.
CLOUD = _profile(depths.CLOUD_DEPTH)
#: One message per tile that a viewer shows, also one that comes late (REP-2003).
MAP = _profile(depths.MAP_DEPTH, latched=True)
#: The same of rings, of which a tile has many.
MAP_RINGS = _profile(depths.RING_DEPTH, latched=True)
#: Many messages per tile, one per ring or building.
BUILDING = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL)
#: The last message is given to late joiners.
LATCHED = _profile(1, latched=True)
#: All messages are given to late joiners.
LATCHED_HISTORY = _profile(depths.HISTORY_DEPTH, latched=True)
#: What sensors send: whoever publishes it, reliable or not, is heard.
SENSOR = QoSProfile(
    reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=depths.SCAN_DEPTH
)
#: What is told of where sensors are, as often as it may be: no scan is placed without.
POSE = QoSProfile(
    reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=depths.POSE_DEPTH
)
#: The same, to be published.
RELIABLE_SENSOR, RELIABLE_POSE = _profile(depths.SCAN_DEPTH), _profile(depths.POSE_DEPTH)
#: Headers and diagnostics: small, a few per tile and node.
EVENT = _profile(depths.EVENT_DEPTH)
#: Such events, given to late joiners as well.
LATCHED_EVENT = _profile(depths.EVENT_DEPTH, latched=True)
#: For publishers: a subscriber whose profile does not match is warned by its own node. Handling such events
#: takes half of the time for which a node wakes.
SILENT_PUBLISHER = PublisherEventCallbacks(use_default_callbacks=False)
#: For subscriptions to what nodes of ours alone publish.
SILENT_SUBSCRIPTION = SubscriptionEventCallbacks(use_default_callbacks=False)
