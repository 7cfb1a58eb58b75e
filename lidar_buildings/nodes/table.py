"""
What each node is: its topics and services in one table; `configs` has the parameters.

The documentation is generated from it, and a test holds the running nodes to it. It needs no ROS.
"""

from __future__ import annotations

from dataclasses import dataclass

from lidar_buildings.core.model.stage_table import STAGE_TABLE, STAGES

_CLOUD = "sensor_msgs/PointCloud2"
_RINGS = "geometry_msgs/PolygonInstanceStamped"
_HEADER = "std_msgs/Header"


@dataclass(frozen=True)
class Topic:
    """
    One topic of a node.

    Attributes
    ----------
    name, type : str
        Relative name and message type.
    qos : str
        The profile's name in `lidar_buildings.ros.qos`.
    meaning : str
        What it carries.
    """

    name: str
    type: str
    qos: str
    meaning: str


@dataclass(frozen=True)
class NodeCard:
    """
    One node.

    Attributes
    ----------
    name : str
        Of the node, its module and its executable.
    summary : str
        Two sentences.
    subscribes, publishes : tuple of Topic
        Beside those of every node.
    services : tuple of (name, type, meaning)
        Beside those of every ROS node.
    """

    name: str
    summary: str
    subscribes: tuple[Topic, ...]
    publishes: tuple[Topic, ...]
    services: tuple[tuple[str, str, str], ...] = ()


DIAGNOSTICS = Topic(
    "diagnostics",
    "diagnostic_msgs/DiagnosticArray",
    "EVENT",
    "per tile: seconds, points, what else the node counts, status, parameters as JSON",
)
TILE_RECEIPT = Topic(
    "tile_receipt",
    "std_msgs/String",
    "LATCHED_EVENT",
    "JSON: `node`, its `life` (another one after a restart), `state`: `ready`, or of tile `stamp` `taken`, "
    "`done` or `failed`",
)
#: What every node publishes beside its own.
OF_EVERY_NODE = (DIAGNOSTICS, TILE_RECEIPT)
POINTS = Topic(
    "points",
    _CLOUD,
    "CLOUD",
    "points as in the source, with `source` and `index` (its row there), `normalised_intensity` (0 to 255); "
    "`buffer` = 1 are the neighbours'",
)
GROUND_POINTS = Topic(
    "ground_points",
    _CLOUD,
    "CLOUD",
    "all points with `classification` (1, 2, 7, 18, and the source's own that are kept: water, bridges …), "
    "`height_above_ground`",
)
DTM = Topic(
    "dtm",
    _CLOUD,
    "CLOUD",
    "the terrain of a tile's own cells on request: an organised cloud, its northernmost row first; "
    "z is NaN where it is not known",
)
CLASSIFIED_POINTS = Topic(
    "classified_points",
    _CLOUD,
    "CLOUD",
    "every point with its final ASPRS class: 1 undecided, 2 ground, 3 to 5 low, medium and high vegetation, "
    "6 building (`facade` = 1: walls and what is under the eaves), 7 and 18 noise, 11 road, and the "
    "source's own that are kept",
)
ROOF_POINTS = Topic(
    "roof_points",
    _CLOUD,
    "CLOUD",
    "the points of class 6 that are no façade, and of these what may hang together with the tile's own",
)
EDGE_POINTS = Topic(
    "edge_points",
    _CLOUD,
    "CLOUD",
    "roof points with `linearity`, `planarity`, `normal_x` `_y` `_z`, `neighbourhood_radius`, `edge` (0, 1)",
)
BUILDING_POINTS = Topic(
    "building_points",
    _CLOUD,
    "CLOUD",
    "edge points with `building_id` (0 = none); in footprints next to without roof points what else stands "
    "there, of other classes than 6",
)
PLANE_POINTS = Topic("plane_points", _CLOUD, "CLOUD", "building points with `plane_id` (0 = none)")
TRACED_OUTLINES = Topic(
    "traced_outlines",
    _RINGS,
    "BUILDING",
    "outlines as traced, or footprints as given; z is the ground's elevation where it is known, else 0",
)
OUTLINES = Topic("outlines", _RINGS, "BUILDING", "regularised outlines")
OUTLINE_QUALITY = Topic(
    "outline_quality",
    "std_msgs/String",
    "CLOUD",
    "JSON of a tile: by building the `sigma` and `max_offset` [m] of its outline from the traced ring, and "
    "why it is the traced one, if it is",
)
ROOF_FACES = Topic("roof_faces", _RINGS, "BUILDING", "the models' roofs in 3D; ids are the buildings'")
CITY_MODEL = Topic("city_model", "std_msgs/String", "BUILDING", "one CityJSONFeature per building")
CITY_MODEL_HEADER = Topic("city_model", "std_msgs/String", "LATCHED", "CityJSON header: CRS and transform")
BUILDING_MARKERS = Topic(
    "building_markers", "visualization_msgs/MarkerArray", "CLOUD", "the solids' edges, for RViz"
)
MAP_ORIGIN = Topic(
    "map_origin",
    "geometry_msgs/PointStamped",
    "LATCHED",
    "what to add to map coordinates [m]; `frame_id` is the coordinate reference system",
)
MAP_UNITS = Topic(
    "map_units",
    "geometry_msgs/Vector3Stamped",
    "LATCHED",
    "metres per unit of the source's x, y and z",
)
TILE_INFO = Topic(
    "tile_info",
    "std_msgs/String",
    "LATCHED_TILE",
    "JSON of a tile: `stamp`, `bounds` (west, south, east, north of it with its buffer; null where nothing "
    "lies beyond), `point_spacing` [m], `dark_limit` (parts the two modes of the ground, if it has two)",
)
TILE_CLIPPED = Topic("tile_clipped", _HEADER, "EVENT", "a building of this tile is not whole")
TILE_DONE = Topic("tile_done", _HEADER, "LATCHED_HISTORY", "this tile is done, or safely on disk")
TILE_FAILED = Topic("tile_failed", _HEADER, "LATCHED_HISTORY", "this tile was given up")
SURVEY_DONE = Topic("survey_done", _HEADER, "LATCHED", "every tile is done or given up")
CLOCK = Topic("/clock", "rosgraph_msgs/Clock", "EVENT", "the stamp of the tile just sent, on request")

_TRIGGER = "std_srvs/Trigger"

NODE_TABLE: tuple[NodeCard, ...] = (
    NodeCard(
        "tile_player",
        "Cuts clouds into tiles and sends them into the graph. "
        "It keeps few tiles in flight, sends again what got lost, and larger what was too small.",
        (TILE_DONE, TILE_CLIPPED, TILE_RECEIPT),
        (POINTS, TILE_INFO, MAP_ORIGIN, MAP_UNITS, SURVEY_DONE, TILE_FAILED, CLOCK),
        (
            ("~/pause", _TRIGGER, "send no more tiles"),
            ("~/resume", _TRIGGER, "go on"),
            ("~/step", _TRIGGER, "send one tile while paused"),
        ),
    ),
    NodeCard(
        "ground_filter",
        "Tells the ground from what stands on it, and low and high noise from both. "
        "It gives every point its height above the ground.",
        (TILE_INFO, POINTS),
        (GROUND_POINTS, DTM),
    ),
    NodeCard(
        "roof_selector",
        "Gives every point its final class: roofs, vegetation by height, roads by the ground's brightness. "
        "The points of class 6 go on as roof points.",
        (TILE_INFO, GROUND_POINTS),
        (CLASSIFIED_POINTS, ROOF_POINTS),
    ),
    NodeCard(
        "edge_labeller",
        "Finds the roof points on edges. It appends the shape of each point's neighbourhood.",
        (TILE_INFO, ROOF_POINTS),
        (EDGE_POINTS,),
    ),
    NodeCard(
        "building_tracer",
        "Gathers roof points into buildings and traces their outlines and courtyards, or takes given "
        "footprints for which it listens to all points. "
        "A tile that cuts one of its buildings off is held back and asked for with a larger buffer.",
        (TILE_INFO, EDGE_POINTS, MAP_ORIGIN, MAP_UNITS, CLASSIFIED_POINTS),
        (BUILDING_POINTS, TRACED_OUTLINES, TILE_CLIPPED),
    ),
    NodeCard(
        "outline_regulariser",
        "Fits straight edges and the building's own directions to traced outlines. "
        "An outline that cannot be regularised goes on as it is.",
        (TRACED_OUTLINES,),
        (OUTLINES, OUTLINE_QUALITY),
    ),
    NodeCard(
        "plane_fitter",
        "Finds the planes of each building's roof. It numbers them within their building.",
        (TILE_INFO, BUILDING_POINTS),
        (PLANE_POINTS,),
    ),
    NodeCard(
        "model_builder",
        "Builds solids from outlines and roof planes. "
        "Every building comes out, with a status that says what became of it.",
        (TILE_INFO, MAP_ORIGIN, MAP_UNITS, PLANE_POINTS, OUTLINES, OUTLINE_QUALITY),
        (ROOF_FACES, CITY_MODEL, CITY_MODEL_HEADER, BUILDING_MARKERS, TILE_DONE),
    ),
    NodeCard(
        "model_writer",
        "Puts each tile's results safely on disk and reports the tile as done. "
        "When the survey is done it makes the files from them and ends.",
        (
            TILE_INFO,
            CLASSIFIED_POINTS,
            PLANE_POINTS,
            TRACED_OUTLINES,
            OUTLINES,
            ROOF_FACES,
            CITY_MODEL,
            SURVEY_DONE,
            TILE_FAILED,
            DIAGNOSTICS,
        ),
        (TILE_DONE,),
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
    (ROOF_FACES,),
    (CITY_MODEL,),
)


def writer_topics(until: str) -> tuple[Topic, ...]:
    """Return what `model_writer` reads of a run that ends with a stage: all points first, then the roofs'."""
    nodes = nodes_until(until)[1:-1]
    published = {topic for card in NODE_TABLE if card.name in nodes for topic in card.publishes}
    found = ([topic for topic in topics if topic in published] for topics in _OF_FILES)
    return tuple(topics[-1] for topics in found if topics)


#: Node → what it listens to only where footprints are given.
ON_REQUEST: dict[str, tuple[Topic, ...]] = {"building_tracer": (MAP_ORIGIN, MAP_UNITS, CLASSIFIED_POINTS)}


def nodes_until(stage: str) -> tuple[str, ...]:
    """Return the nodes that a run ending with `stage` needs, the player first and the writer last."""
    later = {one.node for one in STAGE_TABLE[STAGES.index(stage) + 1 :]}
    return tuple(card.name for card in NODE_TABLE if card.name not in later)


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
