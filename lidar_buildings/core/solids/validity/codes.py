"""The codes of what can be wrong with a solid, and the tolerances, as in val3dity 2.6."""

#: Code → name. Not looked for: 103 (rings are open by definition here), 300 and 304 (no longer in use), 401
#: to 404 (they concern voids, which are not built), 5xx to 7xx (they concern several solids).
CODES = {
    101: "TOO_FEW_POINTS",
    102: "CONSECUTIVE_POINTS_SAME",
    104: "RING_SELF_INTERSECTION",
    201: "INTERSECTION_RINGS",
    202: "DUPLICATED_RINGS",
    203: "NON_PLANAR_POLYGON_DISTANCE_PLANE",
    204: "NON_PLANAR_POLYGON_NORMALS_DEVIATION",
    205: "POLYGON_INTERIOR_DISCONNECTED",
    206: "INNER_RING_OUTSIDE",
    207: "INNER_RINGS_NESTED",
    208: "ORIENTATION_RINGS_SAME",
    301: "TOO_FEW_POLYGONS",
    302: "SHELL_NOT_CLOSED",
    303: "NON_MANIFOLD_CASE",
    305: "MULTIPLE_CONNECTED_COMPONENTS",
    306: "SHELL_SELF_INTERSECTION",
    307: "POLYGON_WRONG_ORIENTATION",
    309: "VERTICES_NOT_USED",
    405: "WRONG_ORIENTATION_SHELL",
    902: "EMPTY_PRIMITIVE",
}
#: Vertices nearer to each other than this count as one [m].
SNAP_TOLERANCE = 0.001
#: Largest distance of a vertex to its face's plane [m].
MAX_PLANE_DISTANCE = 0.01
#: Largest angle between the triangles of one face [deg].
MAX_NORMAL_DEVIATION_DEG = 20.0
#: Share of a tolerance by which what is judged here has to be better than it: others' rounding differs.
MARGIN = 1e-3
#: Distance below which a vertex of a face lies on an edge of it [m].
TOUCHING = 1e-6
