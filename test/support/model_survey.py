"""
Models made by hand, and surveys of them as the writers get them: solids of all kinds, a building without any.
"""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.raising import extrude, roof_solid
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.io.models.cityjson import feature_line
from lidar_buildings.io.results.survey_buildings import SurveyBuildings
from lidar_buildings.io.results.tile_products import Shapes

DUTCH = MapFrame("EPSG:28992", (84900.0, 447400.0, 0.0))
FOOT = 0.3048
FEET = MapFrame("EPSG:2263", (300000.0, 60000.0, 30.0), FOOT, FOOT)
GROUND, EAVE, RIDGE = 1.0, 4.0, 7.0
#: Of the arc in `tower` [m].
RADIUS = 5.0


def rectangle(west, south, east, north):
    return np.array([[west, south], [east, south], [east, north], [west, north]], dtype=np.float64)


def circle(radius=RADIUS, n=24, centre=(60.0, 10.0)):
    """Chords of a circle, rounded as messages carry them."""
    angle = 2.0 * np.pi * np.arange(n) / n
    ring = np.add(centre, radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    return ring.astype(np.float32).astype(np.float64)


def gable():
    """A house of 10 by 8 m whose ridge runs from west to east: 240 m³ under the eaves and 120 m³ above."""
    slope = (RIDGE - EAVE) / 4.0
    pieces = [
        RoofPiece((rectangle(0, 0, 10, 4),), (0.0, slope, EAVE)),
        RoofPiece((rectangle(0, 4, 10, 8),), (0.0, -slope, EAVE + 8.0 * slope)),
    ]
    outline = Outline(rectangle(0, 0, 10, 8))
    return _model(outline, roof_solid(pieces, GROUND))


def step():
    """
    Two flat parts, the higher one along half of the lower one's side: walls with vertices amid their edges.
    """
    low, high = rectangle(20, 0, 26, 8), rectangle(26, 2, 32, 6)
    pieces = [RoofPiece((low,), (0.0, 0.0, 4.0)), RoofPiece((high,), (0.0, 0.0, 9.0))]
    ring = np.array(
        [[20, 0], [26, 0], [26, 2], [32, 2], [32, 6], [26, 6], [26, 8], [20, 8]], dtype=np.float64
    )
    return _model(Outline(ring), roof_solid(pieces, GROUND))


#: How sure corners are along x, y and z [m].
SIGMAS = [0.1, 0.2, 0.05]


def courtyard():
    """A block around a court, with the hole in its roof and in its ground."""
    outline = Outline(rectangle(0, 20, 20, 40), (rectangle(6, 26, 14, 34)[::-1],))
    return _model(outline, extrude(outline, GROUND, RIDGE))


def tower():
    """A round tower."""
    outline = Outline(circle())
    return _model(outline, extrude(outline, GROUND, RIDGE))


def ruin():
    """A building without any solid."""
    attributes = {"ground_elevation": GROUND, "reason": "no roof points"}
    model = BuildingModel({}, attributes, BuildingStatus.DEGENERATE, "no roof points")
    return Outline(rectangle(80, 0, 84, 4)), model


#: Building id → outline and model; volume and level of detail are checked against these.
BUILDINGS = {5: gable, 3: step, 9: courtyard, 2: tower, 7: ruin}


def shapes(frame=DUTCH, buildings=None):
    """Return one tile with some buildings, all by default."""
    chosen = BUILDINGS if buildings is None else buildings
    made = {number: build() for number, build in chosen.items()}
    outlines = tuple(BuildingOutline(number, outline) for number, (outline, _) in made.items())
    lines = tuple(
        feature_line(model, number, frame, model.attributes, anchor=tuple(outline.exterior[0]))
        for number, (outline, model) in made.items()
    )
    return Shapes(outlines, outlines, lines)


def survey(folder, *tiles, frame=DUTCH, **options):
    """Return the buildings of some tiles."""
    buildings = SurveyBuildings(folder / "lines", frame, **options)
    for tile in tiles:
        buildings.add(tile)
    return buildings


def _model(outline, solid):
    """Return an outline and its model at two levels of detail."""
    attributes = {
        "ground_elevation": GROUND,
        "height": RIDGE - GROUND,
        "volume": solid.volume,
        "plane_sigma": 0.02,
        "no_data_share": 0.125,
        "lod": "2.2",
    }
    told = [
        {"elevation_sigma": 0.02, "corner_sigmas": [[SIGMAS] * len(ring) for ring in face]}
        if kind == "RoofSurface"
        else {"position_sigma": 0.1}
        if kind == "WallSurface"
        else {}
        for face, kind in zip(solid.faces, solid.semantics, strict=True)
    ]
    solids = {"1.2": extrude(outline, GROUND, EAVE), "2.2": solid}
    return outline, BuildingModel(solids, attributes, of_faces={"2.2": tuple(told)})
