"""Every topic of the graph; `doc/nodes.md` says what each carries. It needs no ROS."""

from __future__ import annotations

from typing import NamedTuple


class Topic(NamedTuple):
    """One topic of a node."""

    name: str  #: relative
    type: str  #: of its messages
    qos: str  #: the profile's name in `lidar_buildings.ros.qos`

    @property
    def listener_qos(self) -> str:
        """The profile by which our nodes subscribe: what a viewer may see later is volatile for a stage."""
        return {"MAP": "CLOUD", "MAP_RINGS": "BUILDING"}.get(self.qos, self.qos)


_CLOUD, _TEXT, _HEADER = "sensor_msgs/PointCloud2", "std_msgs/String", "std_msgs/Header"
_RINGS = "geometry_msgs/PolygonInstanceStamped"
_HISTORY = "LATCHED_HISTORY"

TOPICS = (
    Topic("points", _CLOUD, "CLOUD"),
    Topic("ground_points", _CLOUD, "CLOUD"),
    Topic("dtm", _CLOUD, "CLOUD"),
    Topic("classified_points", _CLOUD, "CLOUD"),
    Topic("roof_points", _CLOUD, "CLOUD"),
    Topic("edge_points", _CLOUD, "CLOUD"),
    Topic("building_points", _CLOUD, "CLOUD"),
    Topic("plane_points", _CLOUD, "CLOUD"),
    Topic("traced_outlines", _RINGS, "BUILDING"),
    Topic("outlines", _RINGS, "MAP_RINGS"),
    Topic("outline_quality", _TEXT, "CLOUD"),
    Topic("roof_faces", _RINGS, "MAP_RINGS"),
    Topic("city_model", _TEXT, "BUILDING"),
    Topic("city_model", _TEXT, "LATCHED"),  # its header
    Topic("building_markers", "visualization_msgs/MarkerArray", "MAP"),
    Topic("map_origin", "geometry_msgs/PointStamped", "LATCHED"),
    Topic("map_units", "geometry_msgs/Vector3Stamped", "LATCHED"),
    Topic("tile_info", _TEXT, "LATCHED"),
    Topic("node_state", _TEXT, "LATCHED"),
    Topic("tile_done", _HEADER, _HISTORY),
    Topic("tile_failed", _HEADER, _HISTORY),
    Topic("survey_done", _HEADER, "LATCHED"),
    Topic("diagnostics", "diagnostic_msgs/DiagnosticArray", "EVENT"),
    Topic("scan", _CLOUD, "SENSOR"),
    Topic("odometry", "nav_msgs/Odometry", "SENSOR"),
    Topic("/tf", "tf2_msgs/TFMessage", "SENSOR"),
    Topic("/tf_static", "tf2_msgs/TFMessage", _HISTORY),
    Topic("fix", "sensor_msgs/NavSatFix", "SENSOR"),
    Topic("/clock", "rosgraph_msgs/Clock", "EVENT"),
)


def topics_called(*names: str) -> tuple[Topic, ...]:
    """Return the graph's topics of some names: for each none, one, or several of different durability."""
    return tuple(one for name in names for one in TOPICS if one.name == name)


#: What every node publishes beside its own.
OF_EVERY_NODE = topics_called("diagnostics", "node_state")
#: What a recorder records if not told otherwise: what a run can be done from again (the source's points, and
#: where they lie), its results, and how it went. What lies between is much more, and can be made again.
RECORDED = (
    "points",
    "map_origin",
    "map_units",
    "tile_info",
    "traced_outlines",
    "outlines",
    "roof_faces",
    "city_model",
    "diagnostics",
)
