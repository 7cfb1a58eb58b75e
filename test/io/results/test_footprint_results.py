"""The names of given footprints among the results, and each building once."""

import json

import numpy as np
import pytest

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.io.results.footprint_results import FootprintResults
from lidar_buildings.io.results.tile_products import Shapes

RING = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])
GIVEN = FootprintResults({7: "seven", 8: "ächt"}, {"n_used": 3})


def tile(*numbers):
    outlines = tuple(BuildingOutline(number, Outline(RING)) for number in numbers)
    return Shapes(outlines, outlines, tuple(map(line, numbers)))


def line(number):
    building = {"type": "Building", "attributes": {"building_id": number, "status": "ok"}, "geometry": []}
    feature = {"type": "CityJSONFeature", "id": f"b{number}", "CityObjects": {f"b{number}": building}}
    return json.dumps(feature | {"vertices": []}, separators=(",", ":"))


def attributes(text):
    feature = json.loads(text)
    return feature["CityObjects"][feature["id"]]["attributes"]


def test_features_get_the_names_of_their_footprints():
    (found,) = GIVEN.named([tile(7, 8, 9)])
    assert [attributes(text)["footprint_id"] for text in found.features] == ["seven", "ächt", ""]
    assert list(attributes(found.features[0])) == ["building_id", "footprint_id", "status"]
    assert "ächt" in found.features[1]


def test_a_building_that_two_tiles_have_counts_once():
    first, second = GIVEN.named([tile(7), tile(7, 8)])
    assert [one.building_id for one in first.outlines] == [7]
    for group in (second.traced, second.outlines):
        assert [one.building_id for one in group] == [8]
    assert [attributes(text)["building_id"] for text in second.features] == [8]


def test_traced_outlines_pass_unchanged():
    given = [tile(7), tile(7)]
    assert list(FootprintResults.of(None).named(given)) == given
    assert FootprintResults.of(None).summary(2) == {}


def test_the_summary_counts_the_footprints_outside():
    assert GIVEN.summary(2) == {"n_used": 3, "n_outside": 1}


def test_a_line_that_is_no_feature_is_refused():
    with pytest.raises(InputError, match="no CityJSONFeature"):
        list(GIVEN.named([Shapes((), (), ("{}",))]))
