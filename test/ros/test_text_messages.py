"""The quality of outlines, and models, on their way between nodes."""

import json
import math

import numpy as np
import pytest
from std_msgs.msg import String

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.outline import BuildingOutline, Outline, OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.ros import text_messages

SQUARE = Outline(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]))
GOOD = OutlineQuality(0.1 + 0.2, 1 / 3, BuildingStatus.OK, "")
KEPT = OutlineQuality(0.0, 0.0, BuildingStatus.TRACED_OUTLINE, 'too few points for "walls"')


def test_qualities_come_back_to_the_last_bit():
    outlines = [BuildingOutline(7, SQUARE, quality=GOOD), BuildingOutline(2**32 - 1, SQUARE, quality=KEPT)]
    stamp, qualities = text_messages.qualities_of(text_messages.quality_message(123, outlines))
    assert stamp == 123
    assert qualities == {7: GOOD, 2**32 - 1: KEPT}


def test_a_quality_that_could_not_be_measured_stays_unknown():
    failed = OutlineQuality(math.nan, math.nan, BuildingStatus.FAILED, "why")
    message = text_messages.quality_message(1, [BuildingOutline(1, SQUARE, quality=failed)])
    assert "NaN" not in message.data
    found = text_messages.qualities_of(message)[1][1]
    assert math.isnan(found.sigma)
    assert math.isnan(found.max_offset)
    assert (found.status, found.reason) == (BuildingStatus.FAILED, "why")


def test_outlines_of_which_nothing_is_known_have_no_quality():
    assert text_messages.qualities_of(text_messages.quality_message(1, [BuildingOutline(1, SQUARE)])) == (
        1,
        {},
    )


@pytest.mark.parametrize("text", ["", "[]", '{"stamp": 1}', '{"stamp": 1, "outlines": {"1": {"sigma": 0}}}'])
def test_a_message_of_another_form_is_refused(text):
    with pytest.raises(MessageError, match="outline_quality"):
        text_messages.qualities_of(String(data=text))


def test_a_withdrawal_is_a_feature_of_cityjson_without_objects():
    (line,) = (text_messages.withdrawal_message('a "name"').data,)
    assert json.loads(line) == {
        "type": "CityJSONFeature",
        "id": 'a "name"',
        "CityObjects": {},
        "vertices": [],
    }
    assert not text_messages.is_model(line)
    assert text_messages.closed_tile(line) is None


def test_the_end_of_a_tile_names_it():
    line = text_messages.tile_closing_message(77_000_000_001).data
    assert text_messages.closed_tile(line) == 77_000_000_001
    assert not text_messages.is_model(line)
    assert text_messages.closed_tile(line.replace("77", "x")) is None


@pytest.mark.parametrize("line", ["", "[]", '{"type":"CityJSONFeature","id":"tile-5"}', "\x00"])
def test_what_is_no_such_feature_closes_nothing(line):
    assert text_messages.closed_tile(line) is None
