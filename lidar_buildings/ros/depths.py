"""How many messages topics keep. It needs no ROS."""

#: Clouds of a topic: tiles in flight, and copies sent again.
CLOUD_DEPTH = 32

#: Headers and diagnostics: small, a few per tile and node.
EVENT_DEPTH = 1000

#: Headers that late joiners must get all, such as the finished tiles of a survey.
HISTORY_DEPTH = 100_000
