"""The topics of each node in one table, to which a test holds the running nodes. It needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_buildings.core.model.stage_table import STAGE_TABLE, STAGES
from lidar_buildings.nodes.topics import RECORDED, Topic, topics_called

_STAGES = {stage.node: stage for stage in STAGE_TABLE}


@dataclass(frozen=True)
class NodeCard:
    """One node; that of a stage has its topics beside those named here, every node `OF_EVERY_NODE`."""

    name: str  #: of the node, its module and its executable
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
        _SENT,
    ),
    NodeCard("ground_filter", writes=("dtm",)),
    NodeCard("roof_selector"),
    NodeCard("edge_labeller"),
    NodeCard("building_tracer", (*_FRAME, "classified_points")),
    NodeCard("outline_regulariser"),
    NodeCard("plane_fitter"),
    NodeCard("model_builder", _FRAME, ("tile_done",)),
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
ON_REQUEST = {"building_tracer": (*_FRAME, "classified_points"), "model_writer": _FRAME}
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
