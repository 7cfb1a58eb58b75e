"""Reference systems: WKT and GeoTIFF keys, feet, compound systems, and records that make no sense."""

import numpy as np
import pyproj
import pytest
from support import cloud_files

from lidar_buildings.io.clouds.las import open_cloud

FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937


def crs_of(tmp_path, cloud):
    return open_cloud(cloud_files.saved(cloud, tmp_path / "a.laz")).crs


def keyed(keys):
    return cloud_files.with_geo_keys(cloud_files.random_cloud(20), keys)


def worded(crs):
    return cloud_files.with_wkt(cloud_files.random_cloud(20, point_format=6), crs)


def test_a_cloud_without_records_is_in_metres_of_an_unknown_system(tmp_path):
    crs = crs_of(tmp_path, cloud_files.random_cloud(20))
    assert (crs.name, crs.horizontal_unit, crs.vertical_unit) == ("", 1.0, 1.0)


@pytest.mark.parametrize("code", [28992, 2154, 25832, 32754, 26917])
def test_both_kinds_of_record_name_the_code(tmp_path, code):
    assert crs_of(tmp_path, keyed({1024: 1, 3072: code})).name == f"EPSG:{code}"
    assert crs_of(tmp_path, worded(f"EPSG:{code}")).name == f"EPSG:{code}"


def test_a_compound_system_gives_its_horizontal_code_and_vertical_unit(tmp_path):
    text = pyproj.CRS("EPSG:28992+8228").to_wkt()  # NAVD88 height (ft)
    crs = crs_of(tmp_path, worded(text))
    assert (crs.name, crs.horizontal_unit) == ("EPSG:28992", 1.0)
    assert crs.vertical_unit == pytest.approx(FOOT)


@pytest.mark.parametrize(
    ("code", "unit"), [("EPSG:2222", FOOT), ("EPSG:2263", SURVEY_FOOT), ("EPSG:2263+6360", SURVEY_FOOT)]
)
def test_feet_of_both_kinds_are_told_apart(tmp_path, code, unit):
    crs = crs_of(tmp_path, worded(pyproj.CRS(code).to_wkt()))
    assert crs.horizontal_unit == pytest.approx(unit, rel=1e-9)
    assert crs.vertical_unit == pytest.approx(unit, rel=1e-9)


def test_heights_in_metres_over_a_plan_in_feet_are_kept_apart(tmp_path):
    crs = crs_of(tmp_path, worded(pyproj.CRS("EPSG:2263+5703").to_wkt()))
    assert (crs.horizontal_unit, crs.vertical_unit) == (pytest.approx(SURVEY_FOOT), 1.0)


def test_geotiff_keys_tell_units(tmp_path):
    crs = crs_of(tmp_path, keyed({1024: 1, 3072: 2263, 3076: 9003, 4099: 9001}))
    assert (crs.name, crs.horizontal_unit, crs.vertical_unit) == (
        "EPSG:2263",
        pytest.approx(SURVEY_FOOT),
        1.0,
    )
    crs = crs_of(tmp_path, keyed({1024: 1, 3072: 28992, 4096: 8228}))
    assert crs.vertical_unit == pytest.approx(FOOT)
    crs = crs_of(tmp_path, keyed({1024: 1, 3072: 32767, 3076: 9002}))
    assert (crs.name, crs.horizontal_unit, crs.vertical_unit) == ("", FOOT, FOOT)


def test_a_code_that_does_not_fit_the_stated_unit_is_not_believed(tmp_path, caplog):
    crs = crs_of(tmp_path, keyed({1024: 1, 3072: 28992, 3076: 9002}))
    assert (crs.name, crs.horizontal_unit) == ("", FOOT)
    assert "unit" in caplog.text


def test_a_text_without_code_is_kept_as_text(tmp_path):
    own = pyproj.CRS("+proj=tmerc +lat_0=12.3 +lon_0=45.6 +k=0.9 +x_0=1234 +y_0=777 +ellps=bessel +units=m")
    crs = crs_of(tmp_path, worded(own.to_wkt()))
    assert pyproj.CRS(crs.name) == own


@pytest.mark.parametrize("text", ["PROJCS[", "", "nonsense", 'PROJCS["x",GEOGCS[]]'])
def test_a_broken_text_does_not_stop_reading(tmp_path, caplog, text):
    crs = crs_of(tmp_path, worded(text))
    assert (crs.name, crs.horizontal_unit) == ("", 1.0)
    assert "a.laz" in caplog.text


@pytest.mark.parametrize("keys", [{1024: 1, 3072: 1025}, {}, {1024: 1, 3072: 28992, 4096: 1030}])
def test_broken_keys_do_not_stop_reading(tmp_path, keys):
    assert crs_of(tmp_path, keyed(keys)).horizontal_unit == 1.0


def test_broken_text_leaves_the_keys_to_speak(tmp_path):
    cloud = cloud_files.with_geo_keys(worded("nonsense"), {1024: 1, 3072: 28992})
    assert crs_of(tmp_path, cloud).name == "EPSG:28992"


def test_a_text_in_an_extended_record_is_found(tmp_path):
    import laspy

    cloud = cloud_files.random_cloud(20, point_format=6)
    cloud.header.global_encoding.wkt = True
    text = pyproj.CRS("EPSG:2154").to_wkt().encode()
    cloud.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("LASF_Projection", 2112, "", text)])
    assert crs_of(tmp_path, cloud).name == "EPSG:2154"
    assert np.isfinite(open_cloud(tmp_path / "a.laz").mins).all()
