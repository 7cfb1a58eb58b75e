"""Building models: solids, heights, attributes, and what becomes of buildings that get none."""

import numpy as np
import pytest

from bench.scenes import buildings as scenes
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.solids.output_grid import on_grid
from lidar_buildings.core.solids.raising import extrude
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model import model as model_module
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.building_model.result import ATTRIBUTES
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])


def modelled(name, **options):
    scene = scenes.GALLERY[name](**options)
    points = scene.roof_points()
    house = scene.buildings[0]
    plane_id = fit_roof_planes(points).plane_id
    return house, build_model(points, house.outline, plane_id=plane_id, ground_elevation=scenes.GROUND)


def roof(z=6.0, seed=0):
    random = np.random.default_rng(seed)
    return np.column_stack([random.uniform(0, 10, (600, 2)), random.normal(z, 0.02, 600)])


@pytest.mark.parametrize(
    "name",
    ["flat", "shed", "gable", "hip", "l_shape", "t_shape", "step_roof", "dormer", "courtyard", "round_tower"],
)
def test_every_house_of_the_gallery_gets_a_valid_solid(name):
    house, model = modelled(name, rotation_deg=33)
    assert model.status is BuildingStatus.OK
    assert tuple(model.attributes) == ATTRIBUTES
    assert model.attributes["validity"] == []
    solid = model.solids["1.2"]
    assert check_solid(solid) == ()
    # Vertices move by half a millimetre at most when rounded.
    perimeter = house.polygon.length
    assert model.attributes["area"] == pytest.approx(house.outline.area, abs=0.001 * perimeter)
    assert solid.volume == pytest.approx(model.attributes["area"] * model.attributes["height"], rel=1e-6)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("flat", "flat"),
        ("step_roof", "flat"),
        ("shed", "shed"),
        ("gable", "gable"),
        ("hip", "hip"),
        ("l_shape", "L"),
        ("t_shape", "T"),
        ("round_tower", "flat"),
    ],
)
def test_the_kind_of_roof_is_told_from_its_planes(name, kind):
    _, model = modelled(name, rotation_deg=-15)
    assert model.attributes["roof_type"] == kind


def test_without_planes_the_kind_of_roof_is_unknown():
    bare = build_model(roof(), Outline(SQUARE), ground_elevation=0.0).attributes
    assert bare["roof_type"] == "unknown"
    assert bare["n_planes"] is None
    none_found = build_model(roof(), Outline(SQUARE), plane_id=np.zeros(600), ground_elevation=0.0).attributes
    assert none_found["roof_type"] == "unknown"
    assert none_found["n_planes"] == 0


def test_blocks_are_all_that_is_built_if_they_are_asked_for():
    config = BuildingModelConfig(finest_lod="1.2")
    model = build_model(roof(), Outline(SQUARE), config, plane_id=np.ones(600), ground_elevation=0.0)
    assert list(model.solids) == ["1.2"]
    assert model.attributes["lod"] == "1.2"
    assert "asked for" in model.reason


@pytest.mark.parametrize(("choice", "share"), [("min", 0), ("50p", 50), ("70p", 70), ("max", 100)])
def test_the_top_is_the_chosen_elevation_of_the_roof_points(choice, share):
    points = roof()
    model = build_model(
        points, Outline(SQUARE), BuildingModelConfig(roof_elevation=choice), ground_elevation=1.0
    )
    expected = np.percentile(points[:, 2], share)
    assert model.solids["1.2"].vertices[:, 2].max() == pytest.approx(expected, abs=0.0005)
    assert model.attributes[f"roof_elevation_{choice}"] == pytest.approx(expected, abs=0.0005)
    assert model.attributes["height"] == pytest.approx(expected - 1.0, abs=0.001)


def test_vertices_lie_on_the_output_grid():
    outline = Outline(SQUARE + np.random.default_rng(1).uniform(0, 1, SQUARE.shape))
    vertices = build_model(roof(), outline, ground_elevation=0.12345).solids["1.2"].vertices
    assert np.array_equal(vertices, np.round(vertices, 3))
    assert np.array_equal(vertices, on_grid(vertices))


def test_roof_faces_carry_courtyards_at_the_height_of_the_points():
    _, model = modelled("courtyard")
    ((exterior, hole),) = model.roof_faces
    assert exterior.shape[1] == hole.shape[1] == 3
    # The mean of 5000 points with 3 cm of noise, and slopes of less than a millimetre per metre.
    assert np.vstack([exterior, hole])[:, 2] == pytest.approx(18.0, abs=0.01)


def test_a_hole_in_the_points_shows_in_the_coverage():
    points = roof()
    half = points[points[:, 0] < 5]
    full = build_model(points, Outline(SQUARE), ground_elevation=0.0).attributes["coverage"]
    less = build_model(half, Outline(SQUARE), ground_elevation=0.0).attributes["coverage"]
    assert full > 0.99
    # Points reach two spacings of 0.4 m beyond the middle.
    assert less == pytest.approx(0.58, abs=0.04)


def test_vertices_that_fall_together_when_rounded_are_left_out():
    ring = np.insert(SQUARE, 1, SQUARE[0] + [0.0001, 0.0], axis=0)
    model = build_model(roof(), Outline(ring), ground_elevation=0.0)
    assert model.status is BuildingStatus.OK
    assert len(model.solids["1.2"].faces) == 6


def test_a_spike_is_cut_off():
    ring = np.array([[0, 0], [10, 0], [10, 5], [15, 5], [10, 5], [10, 10], [0, 10]], dtype=float)
    model = build_model(roof(), Outline(ring), ground_elevation=0.0)
    assert model.status is BuildingStatus.OK
    assert model.solids["1.2"].vertices[:, 0].max() == 10.0


def test_crossing_rings_are_cut_apart_where_little_is_lost():
    knot = np.array([[0, 0], [10, 0], [10, 10], [0.1, 10], [-0.1, 10.1], [-0.1, 10], [0.1, 10.1], [0, 9]])
    assert check_solid(extrude(Outline(knot), 0, 5)) == (104,)
    model = build_model(roof(), Outline(knot), ground_elevation=0.0)
    assert model.status is BuildingStatus.OK
    assert "cut apart" in model.reason


def test_a_courtyard_that_touches_the_outer_ring_is_drawn_apart():
    exterior = np.array([[0, 0], [5, 0], [10, 0], [10, 10], [0, 10]], dtype=float)
    hole = np.array([[5.0, 0.0], [4.0, 4.0], [6.0, 4.0]])
    model = build_model(roof(), Outline(exterior, (hole,)), ground_elevation=0.0)
    assert model.status is BuildingStatus.OK
    assert "1 cm" in model.reason
    assert check_solid(model.solids["1.2"]) == ()


def test_what_cannot_be_repaired_has_no_solid_but_its_codes():
    bow = np.array([[0, 0], [10, 10], [10, 0], [0, 10]], dtype=float)
    model = build_model(roof(), Outline(bow), ground_elevation=0.0)
    assert model.status is BuildingStatus.NO_SOLID
    assert "104" in model.reason
    assert model.attributes["validity"] == [104]
    assert model.solids == {}
    assert model.roof_faces == ()
    assert model.attributes["lod"] == ""


def test_a_roof_that_is_not_above_the_ground_is_raised():
    model = build_model(roof(z=6.0), Outline(SQUARE), ground_elevation=6.5)
    assert "not above the ground" in model.reason
    assert model.solids["1.2"].vertices[:, 2].max() == pytest.approx(6.6)
    assert all(check_solid(solid) == () for solid in model.solids.values())


def test_an_unknown_ground_is_assumed_and_said_so():
    points = roof()
    model = build_model(points, Outline(SQUARE), BuildingModelConfig(assumed_height=4.0))
    assert model.status is BuildingStatus.OK
    assert "ground elevation unknown" in model.reason
    assert model.attributes["ground_elevation"] == pytest.approx(points[:, 2].min() - 4.0, abs=0.001)


@pytest.mark.parametrize(
    "points",
    [np.empty((0, 3)), np.ones((1, 3)), np.ones((40, 3)), np.arange(30.0)[:, None] * [1.0, 0.5, 0.1]],
)
def test_too_few_points_give_one_height_and_all_attributes_are_there(points):
    model = build_model(points, Outline(SQUARE), ground_elevation=0.0)
    assert model.status is BuildingStatus.DEGENERATE
    assert model.reason
    assert list(model.solids) == (["1.2"] if len(points) else [])
    assert tuple(model.attributes) == ATTRIBUTES


@pytest.mark.parametrize("ring", [np.empty((0, 2)), SQUARE[:1], SQUARE[:2], np.zeros((4, 2)), SQUARE * 1e-5])
def test_an_outline_without_area_has_no_solid(ring):
    model = build_model(roof(), Outline(ring), ground_elevation=0.0)
    assert model.status is BuildingStatus.NO_SOLID
    assert model.attributes["validity"]


@pytest.mark.parametrize("step", ["find_topology", "partition_outline", "measure_model"])
def test_whatever_fails_above_it_lod12_is_given_with_the_reason(monkeypatch, step):
    def fail(*_, **__):
        raise RuntimeError("a beam broke")

    monkeypatch.setattr(model_module, step, fail)
    model = build_model(roof(), Outline(SQUARE), plane_id=np.ones(600), ground_elevation=0.0)
    assert list(model.solids) == ["1.2"]
    assert check_solid(model.solids["1.2"]) == ()
    assert model.attributes["lod"] == "1.2"
    assert "a beam broke" in model.reason
    assert tuple(model.attributes) == ATTRIBUTES


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf])
def test_a_spacing_that_is_none_is_refused(spacing):
    with pytest.raises(ValueError, match="point_spacing"):
        build_model(roof(), Outline(SQUARE), point_spacing=spacing)


def test_the_order_of_points_does_not_matter():
    scene = scenes.hip()
    points, outline = scene.roof_points(), scene.buildings[0].outline
    plane_id = fit_roof_planes(points).plane_id
    order = np.random.default_rng(4).permutation(len(points))
    one = build_model(points, outline, plane_id=plane_id, ground_elevation=10.0)
    other = build_model(points[order], outline, plane_id=plane_id[order], ground_elevation=10.0)
    assert one.attributes == other.attributes
    assert np.array_equal(one.solids["1.2"].vertices, other.solids["1.2"].vertices)


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match="points"):
        build_model(np.full((3, 3), np.nan), Outline(SQUARE))
    with pytest.raises(ValueError, match="plane_id"):
        build_model(roof(), Outline(SQUARE), plane_id=np.zeros(3))
    with pytest.raises(ValueError, match="ground_elevation"):
        build_model(roof(), Outline(SQUARE), ground_elevation=float("inf"))
