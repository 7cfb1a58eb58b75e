"""How many tiles are under way at most, and how many messages topics keep. It needs no ROS."""

#: Tiles in flight, however small; as many as a host has processes.
MOST_TILES = 8
#: More tiles than asked for are in flight while they have fewer points: processes are at so many for about a
#: second, ten times as long as tiles are on their way.
FEW_POINTS = 300_000
#: Clouds of a topic; wide margin: each tile in flight is sent at most a few times.
CLOUD_DEPTH = 32
#: Tiles with buildings that late viewers see; at most 0.5 MB of markers each.
MAP_DEPTH = 128
#: Rings that late viewers see; wide margin over those of a tile, of which none may be lost: 300 bytes each.
RING_DEPTH = 20_000
#: Headers and diagnostics, small; wide margin: a few per tile and node.
EVENT_DEPTH = 1000
#: Headers that late joiners must get all, as of finished tiles; wide margin: 6,000 km² in tiles of 250 m.
HISTORY_DEPTH = 100_000
#: Scans, and the poses of as long: what comes while a process stands still for half a minute, 50 and 500 Hz.
SCAN_DEPTH, POSE_DEPTH = 2_000, 20_000
