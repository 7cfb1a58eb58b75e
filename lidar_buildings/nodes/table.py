"""
What each node is: its topics and services in one table; `configs` has the parameters.

The documentation is generated from it, and a test holds the running nodes to it. It needs no ROS.
"""

from __future__ import annotations

from dataclasses import dataclass

from lidar_buildings.core.model.stage_table import STAGE_TABLE, STAGES
from lidar_buildings.nodes.topics import (
    BUILDING_POINTS,
    CITY_MODEL,
    CLASSIFIED_POINTS,
    CLOCK,
    DIAGNOSTICS,
    DTM,
    EDGE_POINTS,
    FIX,
    GROUND_POINTS,
    MAP_ORIGIN,
    MAP_UNITS,
    NODE_STATE,
    ODOMETRY,
    OUTLINES,
    PLANE_POINTS,
    POINTS,
    RECORDED,
    SCAN,
    SURVEY_DONE,
    TF,
    TF_STATIC,
    TILE_DONE,
    TILE_FAILED,
    TILE_INFO,
    TRACED_OUTLINES,
    Topic,
    topics_called,
)


@dataclass(frozen=True)
class NodeCard:
    """One node."""

    name: str  #: of the node, its module and its executable
    summary: str  #: two sentences
    #: Beside those of every node.
    subscribes: tuple[Topic, ...]
    publishes: tuple[Topic, ...]
    services: tuple[tuple[str, str, str], ...] = ()  #: beside those of every ROS node


def _stage_card(node: str, summary: str, *also: Topic, publishes: tuple[Topic, ...] = ()) -> NodeCard:
    """Return the card of a stage's node, which reads and writes the stage's topics, and some beside them."""
    stage = next(one for one in STAGE_TABLE if one.node == node)
    reads, writes = (
        [one for name in names for one in topics_called(name)] for names in (stage.reads, stage.writes)
    )
    return NodeCard(node, summary, (TILE_INFO, *reads, *also), (*writes, *publishes))


_TRIGGER = "std_srvs/Trigger"

NODE_TABLE: tuple[NodeCard, ...] = (
    NodeCard(
        "tile_player",
        "Cuts clouds into tiles and sends them into the graph. "
        "It keeps few tiles in flight, sends again what got lost, and larger what was too small.",
        (TILE_DONE, NODE_STATE),
        (POINTS, TILE_INFO, MAP_ORIGIN, MAP_UNITS, SURVEY_DONE, TILE_FAILED, CLOCK),
        (
            ("~/pause", _TRIGGER, "send no more tiles"),
            ("~/resume", _TRIGGER, "go on"),
            ("~/step", _TRIGGER, "send one tile while paused"),
        ),
    ),
    NodeCard(
        "scan_assembler",
        "Places the scans of a moving sensor in the map and gathers them on disk. "
        "A tile is sent when the sensor has left it, and again as a later revision when it has come back.",
        (SCAN, ODOMETRY, TF, TF_STATIC, FIX, MAP_ORIGIN, MAP_UNITS, TILE_DONE, NODE_STATE),
        (POINTS, TILE_INFO, MAP_ORIGIN, MAP_UNITS, SURVEY_DONE, TILE_FAILED),
        (
            ("~/pause", _TRIGGER, "send no more tiles; scans are still gathered"),
            ("~/resume", _TRIGGER, "go on"),
            ("~/step", _TRIGGER, "send one tile while paused"),
            ("~/flush", _TRIGGER, "send all tiles that have new points; `survey_done` follows them"),
            ("~/reset", _TRIGGER, "forget all points and tiles"),
        ),
    ),
    _stage_card(
        "ground_filter",
        "Tells the ground from what stands on it, and low and high noise from both; gives every point its "
        "height above the ground. "
        "A tile that cuts off what may be a wide roof is held back and sent again with a larger buffer.",
        publishes=(DTM,),
    ),
    _stage_card(
        "roof_selector",
        "Gives every point its final class: roofs, vegetation by height, roads by the ground's brightness. "
        "The points of class 6 go on as roof points.",
    ),
    _stage_card(
        "edge_labeller",
        "Finds the roof points on edges. It appends the shape of each point's neighbourhood.",
    ),
    _stage_card(
        "building_tracer",
        "Gathers roof points into buildings and traces their outlines and courtyards, closes outlines behind "
        "walls whose roofs were not seen, or takes given footprints for which it listens to all points. "
        "A tile that cuts one of its buildings off is held back and sent again with a larger buffer.",
        MAP_ORIGIN,
        MAP_UNITS,
        CLASSIFIED_POINTS,
    ),
    _stage_card(
        "outline_regulariser",
        "Fits straight edges and the building's own directions to traced outlines. "
        "An outline that cannot be regularised goes on as it is.",
    ),
    _stage_card(
        "plane_fitter",
        "Finds the planes of each building's roof. It numbers them within their building.",
    ),
    _stage_card(
        "model_builder",
        "Builds solids from outlines and roof planes. "
        "Every building comes out, with a status that says what became of it.",
        MAP_ORIGIN,
        MAP_UNITS,
        publishes=(TILE_DONE,),
    ),
    NodeCard(
        "model_writer",
        "Puts each tile's results safely on disk and reports the tile as done. "
        "When the survey is done it makes the files from them and ends, or goes on if the survey is live.",
        (
            TILE_INFO,
            MAP_ORIGIN,
            MAP_UNITS,
            CLASSIFIED_POINTS,
            PLANE_POINTS,
            TRACED_OUTLINES,
            OUTLINES,
            CITY_MODEL,
            SURVEY_DONE,
            TILE_FAILED,
            DIAGNOSTICS,
        ),
        (TILE_DONE,),
        (
            ("~/save", _TRIGGER, "make the files of a live survey now, of the tiles that are on disk"),
            ("~/reset", _TRIGGER, "forget the tiles of a live survey, after its source was reset"),
        ),
    ),
    NodeCard(
        "recorder",
        "Writes what is published under some topics, these if not told otherwise, to a bag (MCAP). "
        "It is no part of the chain: a run goes on without it if the bag cannot be written.",
        tuple(topic for name in RECORDED for topic in topics_called(name)),
        (),
    ),
)

#: Node → the stage under which its seconds are counted.
NODE_STAGES = {stage.node: stage.name for stage in STAGE_TABLE}
#: What files are made of: all points, the roofs' points, rings, models; of topics that say the same of all
#: points or of the roofs' the last one counts.
_OF_FILES = (
    (GROUND_POINTS, CLASSIFIED_POINTS),
    (EDGE_POINTS, BUILDING_POINTS, PLANE_POINTS),
    (TRACED_OUTLINES,),
    (OUTLINES,),
    (CITY_MODEL,),
)


def writer_topics(until: str) -> tuple[Topic, ...]:
    """Return what `model_writer` reads of a run that ends with a stage: all points first, then the roofs'."""
    nodes = nodes_until(until)[1:-1]
    published = {topic for card in NODE_TABLE if card.name in nodes for topic in card.publishes}
    found = ([topic for topic in topics if topic in published] for topics in _OF_FILES)
    return tuple(topics[-1] for topics in found if topics)


#: Node → what it listens to only where footprints are given, or the survey is live.
ON_REQUEST: dict[str, tuple[Topic, ...]] = {
    "building_tracer": (MAP_ORIGIN, MAP_UNITS, CLASSIFIED_POINTS),
    "model_writer": (MAP_ORIGIN, MAP_UNITS),
}


#: Nodes that tiles come from; a graph has one of them.
SOURCES = ("tile_player", "scan_assembler")


def nodes_until(stage: str, source: str = SOURCES[0]) -> tuple[str, ...]:
    """Return the nodes that a run ending with `stage` needs, the source first and the writer last."""
    without = {one.node for one in STAGE_TABLE[STAGES.index(stage) + 1 :]} | {*SOURCES} - {source}
    return tuple(card.name for card in NODE_TABLE if card.name not in without | {"recorder"})


def topics_until(stage: str, *, has_writer: bool = True) -> tuple[str, ...]:
    """Return the topics that must have a subscriber before such a run may begin."""
    nodes = nodes_until(stage)
    read = {
        topic.name
        for card in NODE_TABLE
        if card.name in nodes[1:-1]
        for topic in card.subscribes
        if topic not in ON_REQUEST.get(card.name, ())
    }
    if has_writer:
        read |= {topic.name for topic in writer_topics(stage)}
    return tuple(sorted(read))
