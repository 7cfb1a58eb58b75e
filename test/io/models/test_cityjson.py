"""CityJSONSeq: what stands in the lines, what comes back, and what cjio says."""

import json

import numpy as np
import pyproj
import pytest
from support import model_survey

from bench.scenes import buildings as scenes
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.io.models.cityjson import feature_line, header_line, load_feature, parse_feature

DUTCH = MapFrame("EPSG:28992", (84900.0, 447400.0, 0.0))
FOOT = 0.3048
FEET = MapFrame("EPSG:2263", (300000.0, 60000.0, 30.0), FOOT, FOOT)
ANCHOR = (12.34, 56.78)


def house(name="courtyard"):
    scene = scenes.GALLERY[name]()
    points = scene.roof_points()
    plane_id = fit_roof_planes(points).plane_id
    return build_model(points, scene.buildings[0].outline, plane_id=plane_id, ground_elevation=scenes.GROUND)


def line_of(model, building_id=7, frame=DUTCH, anchor=ANCHOR):
    return feature_line(model, building_id, frame, model.attributes, anchor=anchor)


def test_the_header_names_version_transform_and_reference_system():
    header = json.loads(header_line(DUTCH))
    assert header["type"] == "CityJSON"
    assert header["version"] == "2.0"
    assert header["transform"] == {"scale": [0.001] * 3, "translate": [84900.0, 447400.0, 0.0]}
    assert header["metadata"]["referenceSystem"] == "https://www.opengis.net/def/crs/EPSG/0/28992"
    assert header["CityObjects"] == {}
    assert header["vertices"] == []


@pytest.mark.parametrize("crs", ["", 'PROJCRS["somewhere"]'])
def test_a_reference_system_without_code_is_left_out(crs):
    assert "metadata" not in json.loads(header_line(MapFrame(crs)))


@pytest.mark.parametrize("frame", [DUTCH, FEET])
def test_written_coordinates_are_those_of_the_source(frame):
    model = house("gable")
    header, feature = json.loads(header_line(frame)), json.loads(line_of(model, frame=frame))
    transform = header["transform"]
    written = np.array(feature["vertices"]) * transform["scale"] + transform["translate"]
    expected = frame.to_source(np.vstack([solid.vertices for solid in model.solids.values()]))
    assert set(map(tuple, np.round(written, 6))) == set(map(tuple, np.round(expected, 6)))


def test_a_feature_has_its_solid_with_semantics_and_sorted_attributes():
    feature = json.loads(line_of(house()))
    assert feature["type"] == "CityJSONFeature"
    assert feature["id"] == "building-84912.3-447456.8"
    building = feature["CityObjects"][feature["id"]]
    assert building["type"] == "Building"
    solid = building["geometry"][0]
    assert (solid["type"], solid["lod"]) == ("Solid", "1.2")
    (shell,), (values,) = solid["boundaries"], solid["semantics"]["values"]
    assert len(shell) == len(values)
    kinds = [solid["semantics"]["surfaces"][value]["type"] for value in values]
    assert kinds.count("GroundSurface") == kinds.count("RoofSurface") == 1
    # The courtyard is a second ring of the roof face.
    assert len(shell[kinds.index("RoofSurface")]) == 2
    attributes = building["attributes"]
    assert list(attributes) == sorted(attributes)
    assert attributes["building_id"] == 7
    assert attributes["status"] == "ok"
    assert all(isinstance(c, int) for vertex in feature["vertices"] for c in vertex)


def by_hand(name="gable", frame=DUTCH, number=5):
    """The line of a model made by hand, at LoD1.2 and LoD2.2."""
    _, model = getattr(model_survey, name)()
    return line_of(model, number, frame)


def test_every_level_of_detail_is_a_solid_of_its_own():
    feature = json.loads(by_hand())
    geometry = feature["CityObjects"][feature["id"]]["geometry"]
    assert [one["lod"] for one in geometry] == ["1.2", "2.2"]
    assert {one["type"] for one in geometry} == {"Solid"}
    # the levels share vertices, and each vertex stands once
    assert len({tuple(v) for v in feature["vertices"]}) == len(feature["vertices"])
    read = parse_feature(by_hand())
    assert read.lod == "2.2"
    assert read.solid.volume == pytest.approx(10 * 8 * 3 * 1.5)
    del geometry[1]
    read = parse_feature(json.dumps(feature))
    assert read.lod == "1.2"
    assert read.solid.volume == pytest.approx(10 * 8 * 3)


def test_each_roof_face_has_a_surface_with_slope_azimuth_and_area():
    feature = json.loads(by_hand())
    semantics = feature["CityObjects"][feature["id"]]["geometry"][1]["semantics"]
    roofs = [surface for surface in semantics["surfaces"] if surface["type"] == "RoofSurface"]
    assert [surface["azimuth_deg"] for surface in roofs] == [180.0, 0.0]
    assert [surface["slope_deg"] for surface in roofs] == pytest.approx([36.8699] * 2, abs=1e-4)
    assert [surface["area"] for surface in roofs] == pytest.approx([50.0, 50.0])
    flat = feature["CityObjects"][feature["id"]]["geometry"][0]["semantics"]["surfaces"][-1]
    assert flat == {
        "type": "RoofSurface",
        "slope_deg": 0.0,
        "azimuth_deg": None,
        "area": 80.0,
        "plane_a": 0.0,
        "plane_b": 0.0,
        "plane_c": 4.0,
    }
    used = [value for shell in semantics["values"] for value in shell]
    assert sorted(set(used)) == list(range(len(semantics["surfaces"])))


def test_volumes_and_areas_of_faces_follow_the_units():
    metres, feet = (parse_feature(by_hand(frame=frame)).attributes for frame in (DUTCH, FEET))
    assert metres["volume"] == pytest.approx(360.0)
    assert feet["volume"] == pytest.approx(360.0 / FOOT**3, abs=1e-3)
    assert feet["plane_sigma"] == pytest.approx(0.02 / FOOT, abs=1e-4)
    assert feet["no_data_share"] == metres["no_data_share"] == 0.125
    feature = json.loads(by_hand(frame=FEET))
    surfaces = feature["CityObjects"][feature["id"]]["geometry"][1]["semantics"]["surfaces"]
    walls, roofs = ([one for one in surfaces if one["type"] == f"{kind}Surface"] for kind in ("Wall", "Roof"))
    assert [one["position_sigma"] for one in walls] == [pytest.approx(0.1 / FOOT, abs=1e-4)]
    sigmas = np.array(roofs[-1]["corner_sigmas"][0])
    assert sigmas == pytest.approx(np.tile(np.array(model_survey.SIGMAS) / FOOT, (4, 1)), abs=1e-4)
    assert roofs[-1]["area"] == pytest.approx(50.0 / FOOT**2, abs=1e-3)
    assert roofs[-1]["slope_deg"] == pytest.approx(36.8699, abs=1e-4)


@pytest.mark.parametrize(
    ("horizontal", "vertical", "named"), [(28992, 5709, 7415), (2154, 5720, 5698), (26917, 5713, 26917)]
)
def test_a_known_vertical_system_is_named_where_the_pair_has_a_code(horizontal, vertical, named):
    pair = pyproj.crs.CompoundCRS("pair", [f"EPSG:{horizontal}", f"EPSG:{vertical}"]).to_wkt()
    header = json.loads(header_line(MapFrame(f"EPSG:{horizontal}"), crs=pair))
    assert header["metadata"]["referenceSystem"] == f"https://www.opengis.net/def/crs/EPSG/0/{named}"


def test_the_header_tells_title_and_extent_in_source_coordinates():
    extent = np.array([[0.0, 0.0, 1.0], [10.0, 8.0, 7.0]])
    metadata = json.loads(header_line(FEET, extent=extent, title="Buildings of a"))["metadata"]
    assert metadata["title"] == "Buildings of a"
    assert metadata["geographicalExtent"] == pytest.approx(FEET.to_source(extent).ravel(), abs=1e-6)


def test_what_is_read_back_is_what_was_checked():
    model = house("l_shape")
    line = line_of(model, building_id=2**32 - 1)
    read = parse_feature(line)
    before, after = model.solids[read.lod], read.solid
    assert load_feature(line)[1] == read.attributes["building_id"] == 2**32 - 1
    assert check_solid(after) == ()
    assert after.semantics == before.semantics
    assert after.volume == pytest.approx(before.volume, rel=1e-12)
    for face_before, face_after in zip(before.faces, after.faces, strict=True):
        for a, b in zip(before.face_rings(face_before), after.face_rings(face_after), strict=True):
            assert np.array_equal(a, b)


def test_lengths_in_feet_are_written_in_feet():
    model = house("flat")
    metres, feet = (parse_feature(line_of(model, frame=frame)).attributes for frame in (DUTCH, FEET))
    assert feet["height"] == pytest.approx(metres["height"] / FOOT, abs=1e-4)
    assert feet["area"] == pytest.approx(metres["area"] / FOOT**2, abs=1e-4)
    assert feet["ground_elevation"] == pytest.approx((metres["ground_elevation"] + 30.0) / FOOT, abs=1e-4)
    assert feet["n_points"] == metres["n_points"]
    assert feet["coverage"] == metres["coverage"]


def test_a_building_without_solid_keeps_its_line_with_the_reason():
    model = build_model(np.zeros((0, 3)), scenes.flat().buildings[0].outline)
    feature = json.loads(line_of(model))
    building = feature["CityObjects"][feature["id"]]
    assert building["geometry"] == []
    assert feature["vertices"] == []
    assert building["attributes"]["status"] == "degenerate"
    assert building["attributes"]["reason"]
    assert parse_feature(line_of(model))[2:] == (None, "", None, ())


def test_numbers_that_are_not_finite_become_null():
    model = house("flat")
    line = feature_line(
        model, 1, DUTCH, {"outline_sigma": float("nan"), "rmse": np.float64("inf")}, anchor=ANCHOR
    )
    assert parse_feature(line).attributes["outline_sigma"] is None
    assert parse_feature(line).attributes["rmse"] is None


def test_the_same_building_gives_the_same_line():
    first, second = house("hip"), house("hip")
    backwards = dict(reversed(second.attributes.items()))
    assert line_of(first) == feature_line(second, 7, DUTCH, backwards, anchor=ANCHOR)
    assert "\n" not in line_of(first)


@pytest.mark.parametrize(
    "line", ["", "{", "[]", "{}", '{"type":"CityJSON"}', '{"type":"CityJSONFeature","id":"a"}']
)
def test_a_line_that_is_no_feature_is_refused(line):
    with pytest.raises(InputError, match="CityJSONFeature"):
        parse_feature(line)
