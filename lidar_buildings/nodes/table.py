"""
Every topic of the graph, and the nodes that read and write it, to which a test holds the running nodes.

`doc/nodes.md` says what each topic carries. It needs no ROS.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from lidar_buildings.core.model.stage_table import STAGE_TABLE, STAGES


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
    Topic("street_points", _CLOUD, "CLOUD"),
    Topic("road_points", _CLOUD, "CLOUD"),
    Topic("newer_points", _CLOUD, "CLOUD"),
    Topic("facades", _RINGS, "MAP_RINGS"),
    Topic("facade_records", _TEXT, "CLOUD"),
    Topic("facade_markers", "visualization_msgs/MarkerArray", "MAP"),
    Topic("wall_map", "nav_msgs/OccupancyGrid", "MAP"),
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
    Topic("odometry", "nav_msgs/Odometry", "POSE"),
    Topic("/tf", "tf2_msgs/TFMessage", "POSE"),
    Topic("/tf_static", "tf2_msgs/TFMessage", _HISTORY),
    Topic("fix", "sensor_msgs/NavSatFix", "POSE"),
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


_STAGES = {stage.node: stage for stage in STAGE_TABLE}


@dataclass(frozen=True)
class NodeCard:
    """One node; that of a stage has its topics beside those named here, every node `OF_EVERY_NODE`."""

    name: str  #: of the node and its executable
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()

    @property
    def subscribes(self) -> tuple[Topic, ...]:
        """The topics that the node subscribes to; of several of one name it takes the first."""
        if self.name == "recorder":
            return topics_called(*self.reads)
        stage = _STAGES.get(self.name)
        names = (*self.reads, *(("tile_info", *stage.reads) if stage else ()))
        return tuple(topics_called(name)[0] for name in names)

    @property
    def publishes(self) -> tuple[Topic, ...]:
        """The topics that the node publishes."""
        stage = _STAGES.get(self.name)
        return topics_called(*(stage.writes if stage else ()), *self.writes)


_FRAME = ("map_origin", "map_units")
_SENT = ("points", "tile_info", *_FRAME, "survey_done", "tile_failed")
#: What files are made of: all points, the roofs' points, rings, models; of topics that say the same of all
#: points or of the roofs' the last one counts.
_OF_FILES = (
    ("ground_points", "classified_points"),
    ("edge_points", "building_points", "plane_points"),
    ("traced_outlines",),
    ("outlines",),
    ("facade_records",),
    ("city_model",),
)


def writer_topics(until: str) -> tuple[str, ...]:
    """Return what `model_writer` reads of a run that ends with a stage: all points first, then the roofs'."""
    written = {name for stage in STAGE_TABLE[: STAGES.index(until) + 1] for name in stage.writes}
    found = ([name for name in names if name in written] for names in _OF_FILES)
    return tuple(names[-1] for names in found if names)


NODE_TABLE: tuple[NodeCard, ...] = (
    NodeCard("tile_player", ("tile_done", "node_state"), (*_SENT, "/clock")),
    NodeCard(
        "scan_assembler",
        ("scan", "odometry", "/tf", "/tf_static", "fix", *_FRAME, "tile_done", "node_state"),
        (*_SENT, "road_points", "newer_points"),
    ),
    NodeCard("ground_filter", writes=("dtm",)),
    NodeCard("roof_selector"),
    NodeCard("edge_labeller"),
    NodeCard("building_tracer", (*_FRAME, "classified_points")),
    NodeCard("outline_regulariser"),
    NodeCard("facade_finder", ("road_points",)),
    NodeCard("plane_fitter"),
    NodeCard("model_builder", (*_FRAME, "newer_points"), ("tile_done",)),
    NodeCard(
        "model_writer",
        ("tile_info", *_FRAME, *writer_topics(STAGES[-1]), "survey_done", "tile_failed", "diagnostics"),
        ("tile_done",),
    ),
    NodeCard("recorder", RECORDED),
)

#: Node → the stage under which its seconds are counted.
NODE_STAGES = {stage.node: stage.name for stage in STAGE_TABLE}
#: Node → what it listens to only where footprints are given, or the survey is live.
ON_REQUEST = {
    "building_tracer": (*_FRAME, "classified_points"),
    "facade_finder": ("road_points",),
    "model_builder": ("newer_points",),
    "model_writer": _FRAME,
}
#: Nodes that tiles come from; a graph has one of them.
SOURCES = ("tile_player", "scan_assembler")


def nodes_until(stage: str, source: str = SOURCES[0]) -> tuple[str, ...]:
    """Return the nodes that a run ending with `stage` needs, the source first and the writer last."""
    stages = (one.node for one in STAGE_TABLE[: STAGES.index(stage) + 1])
    return (source, *stages, "model_writer")


def topics_until(stage: str, *, has_writer: bool = True) -> tuple[str, ...]:
    """Return the topics that must have a subscriber before such a run may begin."""
    cards = [card for card in NODE_TABLE if card.name in nodes_until(stage)[1:-1]]
    topics = {card.name: {topic.name for topic in card.subscribes} for card in cards}
    read = {name for node, of in topics.items() for name in of.difference(ON_REQUEST.get(node, ()))}
    return tuple(sorted({*read, *(writer_topics(stage) if has_writer else ())}))
