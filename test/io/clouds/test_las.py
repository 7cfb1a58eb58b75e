"""Reading clouds: every format and version, columns, frames, and one line for each way a file can be bad."""

import struct

import laspy
import numpy as np
import pyproj
import pytest
from support import cloud_files

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.io.clouds import las
from lidar_buildings.io.clouds.find_inputs import find_inputs
from lidar_buildings.io.clouds.las import frame_of, open_cloud, open_inputs, read_extent, read_tile
from lidar_buildings.io.clouds.point_columns import xyz_of

VERSIONS_OF_FORMATS = [
    (version, point_format)
    for version, formats in (("1.1", (0, 1)), ("1.2", (0, 3)), ("1.3", (0, 5)), ("1.4", range(11)))
    for point_format in formats
]


def cloud_at(path, **options):
    return cloud_files.saved(cloud_files.random_cloud(**options), path)


def the_line(call, *arguments):
    with pytest.raises(InputError) as caught:
        call(*arguments)
    line = str(caught.value)
    assert "\n" not in line
    assert line.count(": ") >= 2, "which file: what is wrong: what to do"
    return line


@pytest.mark.parametrize("ending", [".las", ".laz", ".LAZ"])
@pytest.mark.parametrize(("version", "point_format"), VERSIONS_OF_FORMATS)
def test_every_version_and_format_is_read(tmp_path, version, point_format, ending):
    cloud = cloud_files.random_cloud(300, point_format=point_format, version=version)
    if point_format > 8:
        cloud.points.array["classification_flags"] &= 0xCF  # lazrs: waveforms, one scanner channel
    with open(tmp_path / f"a{ending}", "wb+") as file:
        cloud.write(file, do_compress=ending.lower() == ".laz")
    tile = read_tile(tmp_path / f"a{ending}")
    assert np.allclose(tile.frame.to_source(tile.points), np.asarray(cloud.xyz), atol=1e-4)
    assert np.array_equal(tile.intensity, cloud.intensity)
    assert np.array_equal(tile.return_number, cloud.return_number)
    assert np.array_equal(tile.number_of_returns, cloud.number_of_returns)
    assert np.array_equal(tile.classification, np.where(cloud.withheld, 7, cloud.classification))
    assert np.array_equal(tile.point_source_id, cloud.point_source_id)
    assert np.array_equal(tile.scan_direction_flag, cloud.scan_direction_flag)
    assert np.array_equal(tile.index, np.arange(300))
    assert (tile.source == 0).all()
    if point_format in (0, 2):
        assert tile.gps_time is None
    else:
        assert np.array_equal(tile.gps_time, cloud.gps_time)


def test_las_1_0_is_read(tmp_path):
    path = cloud_files.patched(cloud_at(tmp_path / "old.las", point_format=1), 25, b"\0")
    assert open_cloud(path).header.version == "1.0"
    assert len(read_tile(path)) == 500


def test_copc_is_read_as_plain_laz(tmp_path):
    cloud = cloud_files.random_cloud(400, point_format=7)
    tile = read_tile(cloud_files.saved_copc(cloud, tmp_path / "a.copc.laz"))
    assert np.array_equal(tile.classification, np.where(cloud.withheld, 7, cloud.classification))
    assert np.allclose(tile.frame.to_source(tile.points), np.asarray(cloud.xyz), atol=1e-4)


def test_legacy_scan_angles_are_degrees_and_new_ones_are_scaled(tmp_path):
    old = cloud_files.random_cloud(point_format=1)
    assert np.array_equal(
        read_tile(cloud_files.saved(old, tmp_path / "o.las")).scan_angle, old.scan_angle_rank
    )
    new = cloud_files.random_cloud(point_format=6)
    found = read_tile(cloud_files.saved(new, tmp_path / "n.las")).scan_angle
    assert np.allclose(found, new.points.array["scan_angle"] * 0.006, atol=1e-5)


def test_return_numbers_and_times_that_are_all_zero_are_unknown(tmp_path):
    cloud = cloud_files.random_cloud(point_format=1)
    cloud.points.array["bit_fields"] = 0
    cloud.points.array["gps_time"] = 0.0
    tile = read_tile(cloud_files.saved(cloud, tmp_path / "a.laz"))
    assert tile.return_number is None
    assert tile.number_of_returns is None
    assert tile.gps_time is None


@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize("n_points", [0, 1])
def test_no_point_and_one_point_are_legal(tmp_path, n_points, ending):
    tile = read_tile(cloud_at(tmp_path / f"few{ending}", n_points=n_points))
    assert len(tile) == n_points


def test_chunks_are_the_file_in_its_order(tmp_path):
    cloud = cloud_files.random_cloud(1000, point_format=3)
    path = cloud_files.saved(cloud, tmp_path / "a.laz")
    chunks = list(open_cloud(path).chunks(300))
    assert [len(chunk) for chunk in chunks] == [300, 300, 300, 100]
    assert np.array_equal(np.concatenate([chunk.array for chunk in chunks]), cloud.points.array)


def test_the_origin_is_the_lower_corner_rounded_down_to_100_m(tmp_path):
    path = cloud_at(tmp_path / "a.las", corner=(85010.0, 447290.0, -3.0))
    assert read_tile(path).frame.origin == (85000.0, 447200.0, 0.0)


def test_wrong_bounds_in_the_header_are_measured_anew(tmp_path, caplog):
    path = cloud_at(tmp_path / "a.las")
    honest = open_cloud(path)
    cloud_files.patched(path, 179, struct.pack("<6d", *([0.0] * 6)))
    cloud = open_cloud(path)
    assert np.allclose(cloud.mins, honest.mins)
    assert np.allclose(cloud.maxs, honest.maxs)
    assert "bounds" in caplog.text


def test_what_is_missing_or_empty_and_a_folder_in_place_of_a_file_are_named(tmp_path):
    assert "no such file" in the_line(find_inputs, tmp_path / "gone.laz")
    assert "no such file" in the_line(open_cloud, tmp_path / "gone.laz")
    assert str(tmp_path) in the_line(find_inputs, tmp_path)
    assert "*.laz" in the_line(find_inputs, tmp_path / "*.laz")
    (tmp_path / "empty.laz").touch()
    assert "empty.laz: is empty (0 bytes)" in the_line(open_cloud, tmp_path / "empty.laz")
    assert str(tmp_path) in the_line(open_cloud, tmp_path)


def test_folders_patterns_and_files_are_expanded_once_each(tmp_path):
    for name in ("b.laz", "A.LAS", "c.copc.laz", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "sub.laz").mkdir()
    found = find_inputs([tmp_path / "b.laz", tmp_path, tmp_path / "*.laz"])
    assert [path.name for path in found] == ["b.laz", "A.LAS", "c.copc.laz"]


@pytest.mark.parametrize("content", [b"x", b"LASF", b"hello world" * 100])
def test_a_file_of_another_kind_is_named(tmp_path, content):
    (tmp_path / "text.las").write_bytes(content)
    assert "text.las" in the_line(open_cloud, tmp_path / "text.las")


@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize("share", [0.05, 0.3, 0.7, 0.999])
def test_a_file_cut_short_is_named(tmp_path, share, ending):
    path = cloud_files.shortened(cloud_at(tmp_path / f"cut{ending}", n_points=3000), share)
    line = the_line(read_tile, path)
    assert f"cut{ending}" in line
    assert "truncated" in line or "damaged" in line


def test_damaged_points_are_named_and_not_returned(tmp_path):
    path = cloud_at(tmp_path / "hurt.laz", n_points=120_000)
    size = path.stat().st_size
    cloud_files.patched(
        path, size // 2, bytes(np.random.default_rng(0).integers(0, 256, 4000, dtype=np.uint8))
    )
    try:
        n_read = sum(len(chunk) for chunk in open_cloud(path).chunks())
    except InputError as error:
        assert "hurt.laz" in str(error)  # noqa: PT017 - either is right: LAZ has no checksum
    else:
        assert n_read == 120_000


@pytest.mark.parametrize(
    ("at", "content"),
    [
        (94, struct.pack("<H", 10)),  # header size
        (96, struct.pack("<I", 0)),  # offset to the points
        (96, struct.pack("<I", 2**31)),
        (100, struct.pack("<I", 2**32 - 1)),  # number of records
        (104, b"\x3f"),  # point format
        (105, struct.pack("<H", 3)),  # point size
        (131, struct.pack("<d", 0.0)),  # x scale
        (131, struct.pack("<d", np.nan)),
        (131, struct.pack("<d", 1e30)),
        (155, struct.pack("<d", np.inf)),  # x offset
        (155, struct.pack("<d", 1e300)),
    ],
)
def test_a_damaged_header_is_named(tmp_path, at, content):
    path = cloud_files.patched(cloud_at(tmp_path / "hurt.las"), at, content)
    assert "hurt.las" in the_line(open_cloud, path)


def test_more_chunks_than_a_file_has_room_for_are_refused_before_memory_is_taken(tmp_path):
    path = cloud_at(tmp_path / "chunks.laz")
    (start,) = struct.unpack_from("<I", path.read_bytes(), 96)
    (table,) = struct.unpack_from("<q", path.read_bytes(), start)
    cloud_files.patched(path, table + 4, struct.pack("<I", 2**32 - 1))
    assert "chunks.laz: is damaged (4294967295 chunks of 50000 points)" in the_line(open_cloud, path)
    cloud_files.patched(path, start, struct.pack("<q", -1))
    path.write_bytes(path.read_bytes() + struct.pack("<q", table))
    assert "is damaged (4294967295 chunks" in the_line(read_tile, path)
    large = cloud_at(tmp_path / "large.laz")
    record = large.read_bytes().index(b"laszip encoded") - 2 + 54
    cloud_files.patched(large, record + 12, struct.pack("<I", 2**32 - 2))
    assert "large.laz: is damaged (1 chunks of 4294967294 points)" in the_line(open_cloud, large)


def test_what_is_missing_or_bad_does_not_keep_the_others_from_being_read(tmp_path):
    good = cloud_at(tmp_path / "good.las")
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad").touch()
    missing = [tmp_path / "gone.laz", tmp_path / "*.laz", tmp_path / "empty", tmp_path / "bad"]
    clouds, problems = open_inputs([missing[0], good, *missing[1:]])
    assert [cloud.path for cloud in clouds] == [good]
    assert [line.split(": ")[0] for line in problems] == [str(path) for path in missing]
    with pytest.raises(InputError) as caught:
        open_inputs(missing)
    assert str(caught.value).splitlines() == problems


class PanicException(BaseException):
    pass


def test_a_panic_of_the_decoder_becomes_one_line(tmp_path, monkeypatch):
    path = cloud_at(tmp_path / "a.laz")

    def panic(self, n):
        raise PanicException("called `Result::unwrap()`\non an `Err` value")

    monkeypatch.setattr(laspy.LasReader, "read_points", panic)
    assert "a.laz" in the_line(open_cloud, path)


@pytest.mark.parametrize("wish", [KeyboardInterrupt, SystemExit])
def test_a_wish_to_stop_is_not_taken_for_a_bad_file(tmp_path, monkeypatch, wish):
    path = cloud_at(tmp_path / "a.laz")
    cloud = open_cloud(path)

    def stop(self, n):
        raise wish

    monkeypatch.setattr(laspy.LasReader, "read_points", stop)
    with pytest.raises(wish):
        open_cloud(path)
    with pytest.raises(wish):
        list(cloud.chunks())


def test_more_points_than_an_index_can_name_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(las, "MOST_POINTS", 499)
    assert "split" in the_line(open_cloud, cloud_at(tmp_path / "large.las"))


def test_clouds_in_different_systems_do_not_share_a_frame(tmp_path):
    paths = []
    for code in (28992, 25832):
        cloud = cloud_files.with_geo_keys(cloud_files.random_cloud(), {1024: 1, 3072: code})
        paths.append(cloud_files.saved(cloud, tmp_path / f"{code}.laz"))
    line = the_line(frame_of, [open_cloud(path) for path in paths])
    assert "28992.laz" in line
    assert "25832.laz" in line


def test_a_cloud_without_system_joins_one_that_has_it_and_says_so(tmp_path, caplog):
    known = cloud_files.with_geo_keys(cloud_files.random_cloud(), {1024: 1, 3072: 28992, 4096: 5709})
    paths = [cloud_at(tmp_path / "a.laz"), cloud_files.saved(known, tmp_path / "b.laz")]
    assert frame_of([open_cloud(path) for path in paths]).crs == "EPSG:28992"
    horizontal, vertical = (record.getMessage() for record in caplog.records)
    assert "a.laz" in horizontal
    assert "EPSG:28992" in horizontal
    assert "a.laz" in vertical
    assert "EPSG:5709" in vertical


def test_clouds_that_name_no_system_are_given_one_and_others_no_other_one(tmp_path):
    silent = [open_cloud(cloud_at(tmp_path / "silent.laz"))]
    assert frame_of(silent).crs == ""
    assert frame_of(silent, "EPSG:28992").crs == "EPSG:28992"
    assert frame_of(silent, "EPSG:7415").crs == "EPSG:28992", "of a compound system the horizontal part"
    for crs, why in {
        "EPSG:4326": "must be projected",
        "EPSG:2263": "the unit",
        "Oz": "is not a refer",
    }.items():
        with pytest.raises(ParameterError, match=why):
            frame_of(silent, crs)
    cloud = cloud_files.with_wkt(cloud_files.random_cloud(), "EPSG:28992")
    clouds = [open_cloud(cloud_files.saved(cloud, tmp_path / "dutch.laz"))]
    assert frame_of(clouds, "EPSG:28992").crs == "EPSG:28992"
    assert "dutch.laz: is in EPSG:28992" in the_line(frame_of, clouds, "EPSG:25832")


@pytest.mark.parametrize("apart", [15_000.0, 31_000.0])
def test_clouds_far_apart_share_a_frame_in_which_float32_has_a_millimetre(tmp_path, apart):
    corners = [(85000.0 + along, 447000.0, 0.0) for along in (0.0, apart)]
    clouds = [open_cloud(cloud_at(tmp_path / f"{k}.laz", corner=place)) for k, place in enumerate(corners)]
    frame = frame_of(clouds)
    ends = [frame.to_map(cloud.maxs[None, :] * [1, 1, 0])[0] for cloud in clouds]
    np.testing.assert_allclose(np.float32(ends), ends, rtol=0, atol=5e-4)


def test_clouds_too_far_apart_are_refused_by_name(tmp_path):
    paths = [
        cloud_at(tmp_path / f"{north:.0f}.laz", corner=(85000.0, north, 0.0))
        for north in (447000.0, 487300.0)
    ]
    line = the_line(frame_of, [open_cloud(path) for path in paths])
    assert "447000.laz and " in line
    assert "487300.laz: together they span 40.4 km" in line


def test_of_a_cloud_with_stray_points_the_bounds_are_those_of_the_others(tmp_path, caplog):
    cloud = cloud_files.random_cloud()
    x, y = np.asarray(cloud.x).copy(), np.asarray(cloud.y).copy()
    x[3], y[3] = 0.0, 0.0
    cloud.x, cloud.y = x, y
    opened = open_cloud(cloud_files.saved(cloud, tmp_path / "stray.laz"))
    assert frame_of([opened]).origin == (85000.0, 447000.0, 0.0)
    assert "km from most" in caplog.records[-1].getMessage()


def test_a_point_that_is_far_up_does_not_make_the_bounds_wrong(tmp_path, caplog):
    cloud = cloud_files.random_cloud()
    z = np.asarray(cloud.z).copy()
    z[3] = 100_000.0
    cloud.z = z
    opened = open_cloud(cloud_files.saved(cloud, tmp_path / "high.laz"))
    assert opened.maxs[2] == pytest.approx(100_000.0)
    assert not caplog.records


def test_feet_become_metres_and_go_back(tmp_path):
    cloud = cloud_files.with_wkt(
        cloud_files.random_cloud(point_format=6, corner=(983000.0, 199000.0, 30.0)), "EPSG:2263"
    )
    opened = open_cloud(cloud_files.saved(cloud, tmp_path / "feet.laz"))
    tile = read_tile(opened.path)
    foot = 1200 / 3937
    assert tile.frame.crs == "EPSG:2263"
    assert tile.frame.units == pytest.approx([foot] * 3, rel=1e-12)
    assert np.ptp(tile.points[:, 0]) == pytest.approx(np.ptp(cloud.x) * foot, abs=1e-3)
    source = np.concatenate([xyz_of(chunk) for chunk in opened.chunks()])
    assert np.allclose(tile.frame.to_source(tile.points), source, atol=1e-3)


def test_longitude_and_latitude_are_refused(tmp_path):
    cloud = cloud_files.random_cloud(corner=(84000.0, 447000.0, 0.0), size=(0.01, 0.01, 10.0))
    cloud.header.offsets = np.zeros(3)
    cloud.xyz = np.random.default_rng(0).uniform([4.3, 52.0, 0], [4.31, 52.01, 20], (500, 3))
    bare = cloud_files.saved(cloud, tmp_path / "bare.laz")
    path = cloud_files.saved(cloud_files.with_geo_keys(cloud, {1024: 2, 2048: 4326}), tmp_path / "deg.laz")
    for reader in (open_cloud, read_extent):
        assert "0.010 of y, and 20.0 of z: transform degrees to" in the_line(reader, bare)
        assert "not projected (EPSG:4326)" in the_line(reader, path)


def test_a_system_in_degrees_that_cannot_be_is_doubted(tmp_path, caplog):
    cloud = cloud_files.with_geo_keys(cloud_files.random_cloud(), {1024: 2, 2048: 4326})
    opened = open_cloud(cloud_files.saved(cloud, tmp_path / "odd.laz"))
    assert opened.crs.name == ""
    assert "not degrees" in caplog.text


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["corrupt_points.laz", "unsupported_laszip_1.2r0.laz"])
def test_the_bad_real_files_give_one_line_and_print_nothing(data_folder, capfd, name):
    assert name in the_line(open_cloud, data_folder / "bad" / name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.real_data
def test_real_files_say_what_they_are(data_folder):
    codes = {"fusa/fusa": "EPSG:32754", "isprs/CSite2_first_last": "EPSG:32632", "delft/ahn3_cropped_1": ""}
    codes["lowdensity/lidarhd_792000_6272000_left"] = codes["montpellier/lidarhd_77050_627755"] = "EPSG:2154"
    for name, code in codes.items():
        assert open_cloud(data_folder / f"{name}.laz").crs.name == code
    tile = read_tile(data_folder / "trondheim" / "10444144.laz")
    assert tile.return_number is None
    assert tile.gps_time is None


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


@pytest.mark.parametrize(
    ("crs", "expected"),
    [
        ("EPSG:28992+8228", ("EPSG:28992", 1.0, FOOT)),  # NAVD88 height (ft)
        ("EPSG:2222", ("EPSG:2222", FOOT, FOOT)),
        ("EPSG:2263", ("EPSG:2263", SURVEY_FOOT, SURVEY_FOOT)),
        ("EPSG:2263+6360", ("EPSG:2263", SURVEY_FOOT, SURVEY_FOOT)),
        ("EPSG:2263+5703", ("EPSG:2263", SURVEY_FOOT, 1.0)),
        ({1024: 1, 3072: 2263, 3076: 9003, 4099: 9001}, ("EPSG:2263", SURVEY_FOOT, 1.0)),
        ({1024: 1, 3072: 28992, 4096: 8228}, ("EPSG:28992", 1.0, FOOT)),
        ({1024: 1, 3072: 32767, 3076: 9002}, ("", FOOT, FOOT)),
    ],
)
def test_text_and_keys_tell_the_horizontal_code_and_both_units(tmp_path, crs, expected):
    cloud = worded(pyproj.CRS(crs).to_wkt()) if isinstance(crs, str) else keyed(crs)
    found = crs_of(tmp_path, cloud)
    assert found.name == expected[0]
    assert (found.horizontal_unit, found.vertical_unit) == pytest.approx(expected[1:], rel=1e-9)


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
    cloud = cloud_files.random_cloud(20, point_format=6)
    cloud.header.global_encoding.wkt = True
    text = pyproj.CRS("EPSG:2154").to_wkt().encode()
    cloud.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("LASF_Projection", 2112, "", text)])
    assert crs_of(tmp_path, cloud).name == "EPSG:2154"
    assert np.isfinite(open_cloud(tmp_path / "a.laz").mins).all()
