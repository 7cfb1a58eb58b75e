"""LoD2.3: where walls seen from the street stand under the eaves of a roof seen from above."""

import numpy as np
import pytest

from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.stages.building_model.eaves import SeenWalls, walls_along
from lidar_buildings.core.stages.building_model.model import build_model

EAVES = Outline(np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [0.0, 8.0]]))
NO_POINTS = np.empty((0, 3))


def roof_points(rng, n=1200):
    xy = rng.uniform((0, 0), (12, 8), (n, 2))
    z = 7.5 - 0.6 * np.abs(xy[:, 1] - 4.0) + rng.normal(0, 0.02, n)
    return np.column_stack([xy, z]), np.where(xy[:, 1] < 4.0, 1, 2)


def soffit_points(rng, depth, n=300):
    x, y = rng.uniform(1, 11, n), rng.uniform(0.1, 0.4, n)
    return np.column_stack([x, y, 7.5 - 0.6 * (4.0 - y) - depth + rng.normal(0, 0.01, n)])


def model(walls, points=NO_POINTS):
    roof, plane_id = roof_points(np.random.default_rng(1))
    seen = SeenWalls(np.array(walls, dtype=np.float64).reshape(-1, 2, 2), points)
    return build_model(roof, EAVES, plane_id=plane_id, ground_elevation=0.0, seen=seen)


SOUTH, WEST = [[0.5, 0.5], [11.5, 0.5]], [[0.4, 1.0], [0.4, 7.0]]


def test_eaves_overhang_the_walls_that_were_seen():
    found = model([SOUTH, WEST])
    ground = found.solids["2.3"].vertices[found.solids["2.3"].vertices[:, 2] == 0.0]
    assert ground[:, :2].min(axis=0) == pytest.approx([0.4, 0.5], abs=0.01)
    assert ground[:, :2].max(axis=0) == pytest.approx([12.0, 8.0], abs=0.01)
    assert found.attributes["lod"] == "2.3"
    assert found.solids["2.3"].volume < found.solids["2.2"].volume - 20.0
    assert "OuterCeilingSurface" in found.solids["2.3"].semantics


def test_roofs_seen_from_above_do_not_change():
    with_street, without = model([SOUTH, WEST]), model([])
    assert "2.3" not in without.solids
    for lod in without.solids:
        np.testing.assert_array_equal(with_street.solids[lod].vertices, without.solids[lod].vertices)
    assert with_street.attributes["quality_reasons"] == without.attributes["quality_reasons"]


def test_an_edge_without_eaves_moves_onto_its_wall():
    found = model([[[12.03, 1.0], [11.99, 7.0]]]).solids["2.3"]
    east = found.vertices[found.vertices[:, 0] > 11.5]
    at_wall = 12.03 - 0.04 * (east[:, 1] - 1.0) / 6.0
    assert east[:, 0] == pytest.approx(at_wall, abs=0.002)
    assert "OuterCeilingSurface" not in found.semantics


def test_the_thickness_of_eaves_is_measured_or_said_to_be_assumed():
    rng = np.random.default_rng(2)
    for points, thickness, measured in ((soffit_points(rng, 0.32), 0.32, True), (NO_POINTS, 0.2, False)):
        told = [one for one in model([SOUTH], points).of_faces["2.3"] if "thickness" in one]
        assert told
        assert told[0]["thickness"] == pytest.approx(thickness, abs=0.02)
        assert {one["measured"] for one in told} == {measured}


def test_walls_say_along_which_share_they_were_seen():
    found = model([[[3.0, 0.5], [9.0, 0.5]]])
    shares = [one["seen_share"] for one in found.of_faces["1.2"] if "seen_share" in one]
    assert sorted(shares) == [0.0, 0.0, 0.0, 0.5]


@pytest.mark.parametrize(
    "wall",
    [
        [[3.0, 2.5], [9.0, 2.5]],
        [[3.0, -0.6], [9.0, -0.6]],
        [[3.0, 0.2], [4.0, 1.2]],
        [[3.0, 0.3], [3.4, 0.3]],
    ],
    ids=["too deep", "outside", "askew", "short"],
)
def test_other_walls_say_nothing_of_an_edge(wall):
    found = walls_along(ring_walls(EAVES.rings), np.array([wall]))
    assert np.isnan(found.inside).all()
    assert not found.seen_share.any()
