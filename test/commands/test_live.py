"""What ``lidar-buildings live`` says while nothing comes."""

from types import SimpleNamespace

from lidar_buildings.commands.live import _come, _ros_arguments

CLOUD = ["sensor_msgs/msg/PointCloud2"]


def source(counts, topics):
    return SimpleNamespace(
        tiles=SimpleNamespace(counts=lambda: counts),
        resolve_topic_name=lambda name: f"/uav/{name}",
        get_topic_names_and_types=lambda: list(topics.items()),
        count_publishers=lambda name: int(name != "/silent"),
    )


def test_topics_with_clouds_are_named_where_no_scan_has_come():
    topics = {"/uav/scan": CLOUD, "/os/points": CLOUD, "/silent": CLOUD, "/tf": ["x"]}
    for graph in ("/uav", "/of_another"):
        topics |= {f"{graph}/points": CLOUD, f"{graph}/node_state": ["std_msgs/msg/String"]}
    none = {"scans": 0, "points": 0}
    wanted = "no scan has arrived on /uav/scan; clouds are published on /os/points: --scan TOPIC"
    assert _come(source(none, topics)) == wanted
    assert _come(source(none, {"/uav/scan": CLOUD})) == "no scan has arrived on /uav/scan"
    lasers = {"/uav/scan": [*CLOUD, "sensor_msgs/msg/LaserScan"]}
    wanted = "no scan has arrived on /uav/scan, which is published as sensor_msgs/msg/LaserScan"
    assert _come(source(none, lasers)) == wanted
    assert _come(source({"scans": 2, "points": 3000}, topics)) == "2 scans, 3,000 points"


def test_topics_of_a_feed_are_renamed_for_ros():
    options = SimpleNamespace(topic="/os/points", odometry=None, fix="/gps/fix", reliable=False, namespace="")
    assert _ros_arguments(options) == ["--ros-args", "-r", "scan:=/os/points", "-r", "fix:=/gps/fix"]
    nothing = SimpleNamespace(topic=None, odometry=None, fix=None, reliable=False, namespace="")
    assert _ros_arguments(nothing) == []
