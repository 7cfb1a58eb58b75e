"""How the layers of ``buildings.gpkg`` look in QGIS, and what their columns mean."""

from __future__ import annotations

from itertools import pairwise

from lidar_buildings.core.model.grade import Grade
from lidar_buildings.io.vectors.geopackage_looks import Looks, Style

_GRADES = {Grade.GOOD: "102,166,97", Grade.CHECK: "242,183,77", Grade.POOR: "204,76,64"}
#: From dark to light (viridis).
_RAMP = ("68,1,84", "65,68,135", "42,120,142", "34,168,132", "122,209,81", "253,231,37")
#: Limits of the classes: heights [m], and slopes [degrees].
_HEIGHTS = (0.0, 3.0, 6.0, 9.0, 15.0, 30.0, 1000.0)
_SLOPES = (0.0, 5.0, 20.0, 35.0, 50.0, 65.0, 90.0)

#: Column → what it holds; lengths are in the unit of the reference system.
MEANINGS = {
    "building_id": "Number made from the building's position",
    "readable_id": "Name made from the building's coordinates, the same in every file",
    "footprint_id": "Name of the footprint that was given",
    "status": "ok, or why there is no regular outline or no solid",
    "reason": "Why the status is not ok, or what was assumed",
    "quality": "good, check or poor: whether to trust the model",
    "quality_reasons": "Why the quality is not good",
    "ground_elevation": "Elevation of the solid's base",
    "ground_elevation_min": "Lowest ground under the building",
    "ground_elevation_max": "Highest ground under the building",
    "roof_elevation_min": "Elevation of the lowest roof point",
    "roof_elevation_50p": "Median elevation of the roof points",
    "roof_elevation_70p": "70th percentile of the roof points' elevations",
    "roof_elevation_max": "Elevation of the highest roof point",
    "height": "Height of the LoD1.2 block above its base",
    "area": "Area without courtyards; of a face in its own plane",
    "n_points": "Number of points",
    "point_spacing": "Spacing of the points",
    "outline_sigma": "Standard deviation of traced points from the outline",
    "outline_max_offset": "Largest distance of a traced point from the outline",
    "n_planes": "Number of roof planes that were found",
    "roof_type": "flat, shed, gable, hip, half-hip, pyramid, L, T, complex or unknown",
    "conditions": "What the roof's planes have in common, and what their points refuse",
    "rmse": "Root mean square distance of roof points from the model",
    "plane_sigma": "Standard deviation of roof points from their planes",
    "corner_sigma_xy": "Median standard deviation of the roof's corners along x or y",
    "corner_sigma_z": "Median standard deviation of the roof's corners along z",
    "elevation_sigma": "Standard deviation of the face's elevation",
    "sigma_x": "Standard deviation of the corner along x",
    "sigma_y": "Standard deviation of the corner along y",
    "sigma_z": "Standard deviation along z",
    "sigma_xy": "Standard deviation of the line across, in plan",
    "elevation": "Elevation of the corner",
    "coverage": "Share of the roof that points lie on",
    "no_data_share": "Share of the outline without points",
    "volume": "Volume of the finest solid",
    "lod": "Finest level of detail",
    "validity": "Error codes of val3dity, [] for a valid solid",
    "face": "Number of the roof face within the building",
    "other_face": "Number of the face on the other side",
    "slope_deg": "Slope of the face in degrees, 0 is level",
    "azimuth_deg": "Direction that the face looks to, in degrees clockwise from grid north",
    "plane_a": "The face lies in z = a x + b y + c",
    "plane_b": "The face lies in z = a x + b y + c",
    "plane_c": "The face lies in z = a x + b y + c",
    "elevation_min": "Lowest elevation",
    "elevation_max": "Highest elevation",
    "kind": "Kind of line or corner: ridge, hip, valley, eave, verge or step; of façade: straight or arc",
    "length": "Length",
    "facade_id": "Number of the façade",
    "seen_share": "Share of the length that was seen",
    "seen": "1 if it was seen from the street",
    "sigma": "Standard deviation of the points about the wall",
    "confidence": "From 0 to 1",
}


def looks_in(unit: float) -> Looks:
    """Return styles and meanings for layers in a unit of length [m]."""
    heights = [limit / unit for limit in _HEIGHTS]
    grades = Style("outlines", "grade", "quality", {grade.value: c for grade, c in _GRADES.items()})
    height = Style("outlines", "height", "height", dict(zip(pairwise(heights), _RAMP, strict=True)))
    slope = Style("roof_faces", "slope", "slope_deg", dict(zip(pairwise(_SLOPES), _RAMP, strict=True)))
    return Looks((grades, height, slope), MEANINGS)
