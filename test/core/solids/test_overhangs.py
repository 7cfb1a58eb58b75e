"""Roofs that overhang their walls: volumes and areas that are known, and shells that stay valid."""

from itertools import pairwise

import numpy as np
import pytest
import shapely

from lidar_buildings.core.solids.overhangs import overhung_solid
from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.shell import face_shape

THICKNESS = 0.2


def box(west, south, east, north):
    return np.array([[west, south], [east, south], [east, north], [west, north]], dtype=np.float64)


GABLE = [RoofPiece((box(0, 0, 10, 4),), (0, 0.5, 5)), RoofPiece((box(0, 4, 10, 8),), (0, -0.5, 9))]
#: A low wing before a high part: its eaves end at the step.
STEP = [RoofPiece((box(0, 0, 10, 4),), (0, 0, 5)), RoofPiece((box(0, 4, 10, 8),), (0, 0, 9))]
#: A wing whose roof rises to that of the main part, and beyond.
RISING = [RoofPiece((box(0, 0, 10, 4),), (0.3, 0, 4)), RoofPiece((box(0, 4, 10, 8),), (0, 0, 5.5))]


def areas(solid):
    found = {}
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        found[kind] = found.get(kind, 0.0) + face_shape(solid.face_rings(face)).area
    return found


@pytest.mark.parametrize(
    "walls", [(0.5, 0.5, 9.5, 7.5), (0, 0.5, 10, 7.5), (0, 0.5, 10, 8), (0.5, 0, 9, 7.5)]
)
@pytest.mark.parametrize("pieces", [GABLE, STEP, RISING], ids=["gable", "step", "rising"])
def test_a_roof_holds_what_is_under_it_within_walls_and_a_layer_beyond(pieces, walls):
    plan = shapely.box(*walls)
    solid, codes = overhung_solid(pieces, plan, 0.0, THICKNESS)
    assert codes == ()
    below = beyond = 0.0
    for piece in pieces:
        inner = shapely.Polygon(piece.rings[0]).intersection(plan)
        below += inner.area * piece.elevation(inner.centroid.x, inner.centroid.y)
        beyond += shapely.Polygon(piece.rings[0]).area - inner.area
    assert solid.volume == pytest.approx(below + THICKNESS * beyond, abs=0.02)
    found = areas(solid)
    assert found["GroundSurface"] == pytest.approx(plan.area)
    slopes = [np.hypot(1.0, np.hypot(*piece.plane[:2])) for piece in pieces]
    assert found["RoofSurface"] == pytest.approx(40.0 * sum(slopes), abs=0.02)
    assert found["OuterCeilingSurface"] == pytest.approx(beyond * slopes[0], abs=0.2 * beyond)


def test_soffits_look_down_and_lie_parallel_to_the_roof():
    solid, _ = overhung_solid(GABLE, shapely.box(0.5, 0.5, 9.5, 7.5), 0.0, THICKNESS)
    kinds = zip(solid.faces, solid.semantics, strict=True)
    soffits = [solid.face_rings(face)[0] for face, kind in kinds if kind == "OuterCeilingSurface"]
    assert len(soffits) == 2
    for ring in soffits:
        assert face_shape([ring]).slope_deg > 90.0
        plane = GABLE[0] if ring[:, 1].mean() < 4.0 else GABLE[1]
        depth = [plane.elevation(x, y) - z for x, y, z in ring]
        assert depth == pytest.approx([THICKNESS] * len(ring), abs=0.002)


def test_a_wing_beyond_all_walls_stands_on_the_ground():
    solid, codes = overhung_solid(STEP, shapely.box(0.5, 4, 9.5, 7.5), 0.0, THICKNESS)
    assert codes == ()
    assert areas(solid)["GroundSurface"] == pytest.approx(9 * 3.5 + 40.0)


def test_most_roofs_of_any_planes_give_valid_shells():
    rng = np.random.default_rng(0)
    n_valid = 0
    for _ in range(40):
        cuts = [0.0, *np.sort(rng.uniform(0, 12, rng.integers(1, 3))), 12.0]
        pieces = []
        for west, east in pairwise(cuts):
            middle = rng.uniform(2, 6)
            for south, north in ((0, middle), (middle, 8)):
                plane = (*rng.uniform(-0.5, 0.5, 2), rng.uniform(7, 10))
                pieces.append(RoofPiece((box(west, south, east, north),), plane))
        west, south, east, north = rng.choice([0.0, 0.4, 0.6], 4)
        plan = shapely.box(west, south, 12 - east, 8 - north)
        n_valid += overhung_solid(pieces, plan, 0.0, rng.choice([0.1, 0.2, 0.3]))[1] == ()
    assert n_valid >= 36
