"""Quality of service: three kinds of topic, one profile each."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from lidar_buildings.ros.depths import CLOUD_DEPTH, EVENT_DEPTH, HISTORY_DEPTH

#: One message per tile. The credits of the player bound what is under way, so nothing is overwritten.
CLOUD = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=CLOUD_DEPTH)

#: Many messages per tile, one per ring or building.
BUILDING = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL)

#: The last message is given to whoever comes later.
LATCHED = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
)

#: One message per tile, given to late joiners as long as the tile can be under way.
LATCHED_TILE = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=CLOUD_DEPTH,
)

#: All messages are given to whoever comes later.
LATCHED_HISTORY = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=HISTORY_DEPTH,
)

#: Headers and diagnostics: small, a few per tile and node.
EVENT = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=EVENT_DEPTH)
