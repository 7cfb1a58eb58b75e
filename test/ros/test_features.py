"""Buildings' models on their way to their tile."""

import json

import pytest

from lidar_buildings.ros import features
from lidar_buildings.ros.features import (
    FeaturePool,
    closed_tile,
    is_withdrawal,
    tile_closing_message,
    withdrawal_message,
)


def test_a_tile_takes_its_features_when_all_have_come():
    pool = FeaturePool()
    pool.add(1, "one")
    pool.add(3, "three")
    assert pool.has(())
    assert not pool.has({1, 2, 3})
    assert pool.has({1, 3})
    pool.add(1, "new")
    assert pool.take([1, 3]) == ("new", "three")
    assert not pool.has({1})


def test_a_withdrawal_is_a_feature_of_cityjson_without_objects():
    (line,) = (withdrawal_message('a "name"').data,)
    assert json.loads(line) == {
        "type": "CityJSONFeature",
        "id": 'a "name"',
        "CityObjects": {},
        "vertices": [],
    }
    assert is_withdrawal(line)
    assert closed_tile(line) is None


def test_the_end_of_a_tile_names_it():
    line = tile_closing_message(77_000_000_001).data
    assert closed_tile(line) == 77_000_000_001
    assert is_withdrawal(line)
    assert closed_tile(line.replace("77", "x")) is None


@pytest.mark.parametrize("line", ["", "[]", '{"type":"CityJSONFeature","id":"tile-5"}', "\x00"])
def test_what_is_no_such_feature_closes_nothing(line):
    assert closed_tile(line) is None
    assert not is_withdrawal(line)


def test_features_that_nobody_takes_go_by_number_and_by_size(monkeypatch):
    monkeypatch.setattr(features, "_MAX_FEATURES", 3)
    monkeypatch.setattr(features, "_MAX_CHARACTERS", 20)
    pool = FeaturePool()
    for number in range(5):
        pool.add(number, "feature")
    pool.add(9, "f" * 18)
    pool.add(9, "f" * 17)
    pool.add(10, "10")
    assert pool.take([9, 10]) == ("f" * 17, "10")
    assert not pool._lines
    assert pool._n_characters == 0
