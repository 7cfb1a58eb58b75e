"""What the page of nodes says of each of them, of its topics and its services."""

#: Node → two sentences.
SUMMARIES = {
    "tile_player": "Cuts clouds into tiles and sends them into the graph. It keeps few tiles in flight, "
    "sends again what got lost, and larger what was too small.",
    "scan_assembler": "Places the scans of a moving sensor in the map and gathers them on disk. A tile is "
    "sent when the sensor has left it, and again as a later revision when it has come back.",
    "ground_filter": "Tells the ground from what stands on it, and low and high noise from both; gives "
    "every point its height above the ground. A tile that cuts off what may be a wide roof is held back and "
    "sent again with a larger buffer.",
    "roof_selector": "Gives every point its final class: roofs, vegetation by height, roads by the "
    "ground's brightness. The points of class 6 go on as roof points.",
    "edge_labeller": "Finds the roof points on edges. It appends the shape of each point's neighbourhood.",
    "building_tracer": "Gathers roof points into buildings and traces their outlines and courtyards, "
    "closes outlines behind walls whose roofs were not seen, or takes given footprints for which it listens "
    "to all points. A tile that cuts one of its buildings off is held back and sent again with a larger "
    "buffer.",
    "outline_regulariser": "Fits straight edges and the building's own directions to traced outlines. An "
    "outline that cannot be regularised goes on as it is.",
    "facade_finder": "Finds the walls of buildings that were seen from the street, tells them from fences, "
    "hedges and vehicles, and says how sure it is. Of what was seen from above it makes nothing.",
    "plane_fitter": "Finds the planes of each building's roof. It numbers them within their building.",
    "model_builder": "Builds solids from outlines and roof planes. Every building comes out, with a status "
    "that says what became of it.",
    "model_writer": "Puts each tile's results safely on disk and reports the tile as done. When the survey "
    "is done it makes the files from them and ends, or goes on if the survey is live.",
    "recorder": "Writes what is published under some topics, these if not told otherwise, to a bag (MCAP). "
    "It is no part of the chain: a run goes on without it if the bag cannot be written.",
}
#: Topic → what it carries; two topics have the name `city_model`.
MEANINGS = {
    "points": "points as in the source, with `source` and `index` (its row there), `normalised_intensity` "
    "(0 to 255); `buffer` = 1 are the neighbours'",
    "ground_points": "all points with `classification` (1, 2, 7, 18, and the source's own that are kept: "
    "water, bridges …), `height_above_ground`",
    "dtm": "the terrain of a tile's own cells on request: an organised cloud, its northernmost row first; "
    "z is NaN where it is not known",
    "classified_points": "every point with its final ASPRS class: 1 undecided, 2 ground, 3 to 5 low, "
    "medium and high vegetation, 6 building (`facade` = 1: walls and what is under the eaves, 2: walls over "
    "which no roof was seen), 7 and 18 noise, 11 road, and the source's own that are kept",
    "roof_points": "the points of class 6 that are no façade, and of these what may hang together with the "
    "tile's own; where walls were seen over which no roof was, also all façades there (`facade` 1 and 2) "
    "and the ground about them; where pulses are more than 0.5 m apart, also the ground about roofs",
    "edge_points": "`roof_points` with `linearity`, `planarity`, `normal_x` `_y` `_z`, "
    "`neighbourhood_radius`, `edge` (0, 1)",
    "building_points": "edge points with `building_id` (0 = none); in footprints next to without roof "
    "points what else stands there, of other classes than 6",
    "plane_points": "building points with `plane_id` (0 = none)",
    "diagnostics": "per tile (named as the node): seconds, points, what else the node counts, status, "
    "parameters as JSON; once a second (`NODE: summary`): how the node gets on",
    "node_state": "JSON, a few times a second and when it changes: `node`, its `life` (another one after a "
    "restart), `sequence`, and `tiles`: by stamp `waiting` with the missing parts, `in_hand`, `passed_on` "
    "or `failed`",
    "traced_outlines": "outlines as traced, or footprints as given, a ring a message, holes after their "
    "outline; z is the ground's elevation where it is known, else 0; one with id −1 and no vertices closes "
    "the tile",
    "outlines": "regularised outlines, a ring a message, holes after their outline; a building that a tile "
    "had in an earlier revision and has no more comes without vertices; one with id −1 and no vertices "
    "closes the tile",
    "outline_quality": "JSON of a tile: by building the `sigma` and `max_offset` [m] of its outline from "
    "the traced ring, and why it is the traced one, if it is",
    "street_points": "the points of all classes but noise that were seen from the street (`view` 2 and 3)",
    "newer_points": "points that were measured in tiles after these were sent, some at a time",
    "road_points": "a place beside a vehicle's way with what was seen of it, passed or quiet",
    "facades": "walls as they were seen from the street, an upright face a message, with ids of their own; "
    "one that a tile had in an earlier revision and has no more comes without vertices; one with id −1 and "
    "no vertices closes the tile",
    "facade_records": "JSON of a tile: of each façade its foot line, which steps of it were seen, `bottom` "
    "and `top`, `coverage`, `sigma`, `n_points`, `confidence`, `kind`, `building_id` (−1: not known)",
    "facade_markers": "the façades' edges, for RViz, the surer the more opaque",
    "wall_map": "where the tile's façades stand: 100 in cells that a foot line crosses, 0 where ground was "
    "seen and nothing stands below 2.5 m, −1 where nothing is known, or a car, a hedge or the like stands; "
    "cells of 0.2 m, which fit those of other tiles; a grid a tile, which that of its next revision replaces",
    "roof_faces": "the models' roofs in 3D; ids are the buildings'; one with id −1 and no vertices closes "
    "the tile",
    "city_model": "one CityJSONFeature per building; without `CityObjects` and `vertices` of one that a "
    "tile has no more, and, under the name `tile-STAMP`, after the last one of a tile",
    "city_model header": "CityJSON header: CRS and transform",
    "building_markers": "the solids' edges, for RViz: a marker per building, deleted when its tile has it "
    "no more",
    "map_origin": "what to add to map coordinates [m]; `frame_id` is the coordinate reference system",
    "map_units": "metres per unit of the source's x, y and z",
    "tile_info": "JSON: the source's `life` and its `tiles` in flight: `stamp`, `bounds` (west, south, "
    "east, north of the tile with its buffer; each or all null where nothing lies beyond), `point_spacing` "
    "[m], `dark_limit` (parts the two modes of the ground, if it has two)",
    "tile_done": "this revision of a tile is done, or safely on disk",
    "tile_failed": "this tile was given up",
    "survey_done": "every tile is done or given up",
    "scan": "scans of whatever driver, in its own frame or the map's: x, y, z, a time per point if there "
    "is one, intensity, returns …; quality of service by `qos_overrides`",
    "odometry": "poses of the vehicle or aircraft",
    "/tf": "poses, where tf2_msgs is installed",
    "/tf_static": "mountings, likewise",
    "fix": "latitude and longitude beside odometry: they say where the map lies, in a zone of UTM",
    "/clock": "the stamp of the tile just sent, on request",
}
#: Service of a node → what it does.
SERVICES = {
    "tile_player ~/pause": "send no more tiles",
    "tile_player ~/resume": "go on",
    "tile_player ~/step": "send one tile while paused",
    "scan_assembler ~/pause": "send no more tiles; scans are still gathered",
    "scan_assembler ~/resume": "go on",
    "scan_assembler ~/step": "send one tile while paused",
    "scan_assembler ~/flush": "send all tiles that have new points; `survey_done` follows them",
    "scan_assembler ~/reset": "forget all points and tiles",
    "model_writer ~/save": "make the files of a live survey now, of the tiles that are on disk",
    "model_writer ~/reset": "forget the tiles of a live survey, after its source was reset",
}
