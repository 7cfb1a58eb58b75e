"""Every topic of the graph. It needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass

_CLOUD = "sensor_msgs/PointCloud2"
_RINGS = "geometry_msgs/PolygonInstanceStamped"
_HEADER = "std_msgs/Header"
#: How a tile ends on topics of rings.
_END = "; one with id −1 and no vertices closes the tile"


@dataclass(frozen=True)
class Topic:
    """One topic of a node."""

    #: Relative name and message type.
    name: str
    type: str
    qos: str  #: the profile's name in `lidar_buildings.ros.qos`
    meaning: str  #: what it carries

    @property
    def listener_qos(self) -> str:
        """The profile by which our nodes subscribe: what a viewer may see later is volatile for a stage."""
        return {"MAP": "CLOUD", "MAP_RINGS": "BUILDING"}.get(self.qos, self.qos)


DIAGNOSTICS = Topic(
    "diagnostics",
    "diagnostic_msgs/DiagnosticArray",
    "EVENT",
    "per tile (named as the node): seconds, points, what else the node counts, status, parameters as JSON; "
    "once a second (`NODE: summary`): how the node gets on",
)
NODE_STATE = Topic(
    "node_state",
    "std_msgs/String",
    "LATCHED",
    "JSON, a few times a second and when it changes: `node`, its `life` (another one after a restart), "
    "`sequence`, and `tiles`: by stamp `waiting` with the missing parts, `in_hand`, `passed_on` or `failed`",
)
#: What every node publishes beside its own.
OF_EVERY_NODE = (DIAGNOSTICS, NODE_STATE)
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
    "6 building (`facade` = 1: walls and what is under the eaves, 2: walls over which no roof was seen), "
    "7 and 18 noise, 11 road, and the source's own that are kept",
)
ROOF_POINTS = Topic(
    "roof_points",
    _CLOUD,
    "CLOUD",
    "the points of class 6 that are no façade, and of these what may hang together with the tile's own; "
    "where walls were seen over which no roof was, also all façades there (`facade` 1 and 2) and the ground "
    "about them; where pulses are more than 0.5 m apart, also the ground about roofs",
)
EDGE_POINTS = Topic(
    "edge_points",
    _CLOUD,
    "CLOUD",
    "`roof_points` with `linearity`, `planarity`, `normal_x` `_y` `_z`, `neighbourhood_radius`, `edge` (0, "
    "1)",
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
    "outlines as traced, or footprints as given, a ring a message, holes after their outline; z is the "
    f"ground's elevation where it is known, else 0{_END}",
)
OUTLINES = Topic(
    "outlines",
    _RINGS,
    "MAP_RINGS",
    "regularised outlines, a ring a message, holes after their outline; a building that a tile had in an "
    f"earlier revision and has no more comes without vertices{_END}",
)
OUTLINE_QUALITY = Topic(
    "outline_quality",
    "std_msgs/String",
    "CLOUD",
    "JSON of a tile: by building the `sigma` and `max_offset` [m] of its outline from the traced ring, and "
    "why it is the traced one, if it is",
)
ROOF_FACES = Topic(
    "roof_faces", _RINGS, "MAP_RINGS", f"the models' roofs in 3D; ids are the buildings'{_END}"
)
CITY_MODEL = Topic(
    "city_model",
    "std_msgs/String",
    "BUILDING",
    "one CityJSONFeature per building; without `CityObjects` and `vertices` of one that a tile has no more, "
    "and, under the name `tile-STAMP`, after the last one of a tile",
)
CITY_MODEL_HEADER = Topic("city_model", "std_msgs/String", "LATCHED", "CityJSON header: CRS and transform")
BUILDING_MARKERS = Topic(
    "building_markers",
    "visualization_msgs/MarkerArray",
    "MAP",
    "the solids' edges, for RViz: a marker per building, deleted when its tile has it no more",
)
MAP_ORIGIN = Topic(
    "map_origin",
    "geometry_msgs/PointStamped",
    "LATCHED",
    "what to add to map coordinates [m]; `frame_id` is the coordinate reference system",
)
MAP_UNITS = Topic(
    "map_units", "geometry_msgs/Vector3Stamped", "LATCHED", "metres per unit of the source's x, y and z"
)
TILE_INFO = Topic(
    "tile_info",
    "std_msgs/String",
    "LATCHED",
    "JSON: the source's `life` and its `tiles` in flight: `stamp`, `bounds` (west, south, east, north of the "
    "tile with its buffer; each or all null where nothing lies beyond), `point_spacing` [m], `dark_limit` "
    "(parts the two modes of the ground, if it has two)",
)
TILE_DONE = Topic(
    "tile_done", _HEADER, "LATCHED_HISTORY", "this revision of a tile is done, or safely on disk"
)
TILE_FAILED = Topic("tile_failed", _HEADER, "LATCHED_HISTORY", "this tile was given up")
SURVEY_DONE = Topic("survey_done", _HEADER, "LATCHED", "every tile is done or given up")
SCAN = Topic(
    "scan",
    _CLOUD,
    "SENSOR",
    "scans of whatever driver, in its own frame or the map's: x, y, z, a time per point if there is one, "
    "intensity, returns …; quality of service by `qos_overrides`",
)
ODOMETRY = Topic("odometry", "nav_msgs/Odometry", "SENSOR", "poses of the vehicle or aircraft")
TF = Topic("/tf", "tf2_msgs/TFMessage", "SENSOR", "poses, where tf2_msgs is installed")
TF_STATIC = Topic("/tf_static", "tf2_msgs/TFMessage", "LATCHED_HISTORY", "mountings, likewise")
FIX = Topic(
    "fix",
    "sensor_msgs/NavSatFix",
    "SENSOR",
    "latitude and longitude beside odometry: they say where the map lies, in a zone of UTM",
)
CLOCK = Topic("/clock", "rosgraph_msgs/Clock", "EVENT", "the stamp of the tile just sent, on request")

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
_ALL = tuple(one for one in tuple(globals().values()) if isinstance(one, Topic))


def topics_called(name: str) -> tuple[Topic, ...]:
    """Return the graph's topics of a name: none, one, or several that differ in their durability."""
    return tuple(one for one in _ALL if one.name == name)
