"""Lengths on the ground, against geodesics, and which unit models have."""

import numpy as np
import pyproj
import pytest

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.files.reference_systems import (
    FOOT,
    US_SURVEY_FOOT,
    about_units,
    model_frame,
    true_units,
)


@pytest.mark.parametrize(
    ("crs", "place"),
    [("EPSG:3857", (10.0, 60.0)), ("EPSG:3857", (10.0, 0.0)), ("EPSG:2263", (-74.0, 40.7)),
     ("EPSG:27572", (2.3, 48.8)), ("EPSG:25832", (18.0, 52.0)), ("EPSG:3035", (30.0, 65.0))],
)  # fmt: skip
def test_units_are_lengths_of_geodesics(crs, place):
    system = pyproj.CRS(crs)
    there = pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True)
    x, y = there.transform(*place)
    ends = np.array([[x - 10.0, y], [x + 10.0, y], [x, y - 10.0], [x, y + 10.0]])
    back = pyproj.Transformer.from_crs(system, "EPSG:4326", always_xy=True)
    lon, lat = back.transform(*ends.T)
    *_, metres = pyproj.Geod(ellps="WGS84").inv(lon[::2], lat[::2], lon[1::2], lat[1::2])
    assert true_units(crs, np.array([[x, y]]))[0] == pytest.approx(metres / 20.0, rel=2e-4)


def test_of_what_is_nowhere_on_earth_no_unit_is_known():
    assert np.isnan(true_units("EPSG:4326", np.zeros((1, 2)))).all()
    assert np.isnan(true_units("EPSG:2056", np.array([[np.inf, 0.0], [1e30, 1e30]]))).all()


@pytest.mark.parametrize(
    ("frame", "unit", "codes"),
    [
        (MapFrame("EPSG:28992"), 1.0, []),
        (MapFrame("EPSG:2263", (0, 0, 0), US_SURVEY_FOOT, US_SURVEY_FOOT), US_SURVEY_FOOT, []),
        (MapFrame("EPSG:26918", (0, 0, 0), 1.0, US_SURVEY_FOOT), 1.0, ["mixed_units"]),
        (MapFrame("EPSG:3857", (0, 0, 0), 0.5, 1.0), 1.0, ["not_true_to_scale"]),
        (MapFrame("", (0, 0, 0), FOOT, 1.0), FOOT, ["mixed_units"]),
    ],
)
def test_models_have_the_unit_of_x_and_y(frame, unit, codes):
    assert model_frame(frame).vertical_unit == pytest.approx(unit)
    assert model_frame(frame).horizontal_unit == frame.horizontal_unit
    assert [one.code for one in about_units(frame)] == codes


def test_a_scale_that_varies_over_the_survey_is_told():
    frame = MapFrame("EPSG:3857", (0.0, 0.0, 0.0), 0.50084, 1.0)
    middle = np.array([1_113_195.0, 8_399_738.0]) * 0.50084
    for half, codes in ((100.0, []), (20_000.0, ["scale_varies"])):
        bounds = np.stack([middle - half, middle + half])
        found = [one.code for one in about_units(frame, bounds)]
        assert found[1:] == codes
