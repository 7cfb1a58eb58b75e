"""
Classified files: every point, dimension, record and header field of the input, and the results beside them.
"""

import struct

import laspy
import numpy as np
import pytest
from support import cloud_files

from lidar_buildings.core.model.errors import InputError, OutputError
from lidar_buildings.io.clouds.classified_las import suffix_for, write_classified
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.clouds.las_records import read_raw_header
from lidar_buildings.io.results.classified_files import RESULT

NEW = ("HeightAboveGround", "Facade", "BuildingId", "PlaneId", "EdgeLabel")
LEGACY_CLASSES = np.array([1, 2, 3, 6, 7, 9, 11, 18], dtype=np.uint8)


def results_for(n_points, seed=1):
    random = np.random.default_rng(seed)
    results = np.zeros(n_points, RESULT)
    results["known"] = 1
    results["classification"] = random.choice(LEGACY_CLASSES, n_points)
    results["height_above_ground"] = random.uniform(-1, 30, n_points)
    results["building_id"] = random.integers(0, 2**32, n_points)
    results["plane_id"] = random.integers(0, 2**16, n_points)
    results["edge"] = random.integers(0, 2, n_points)
    return results


def classified(path, results=None, name="out.laz"):
    cloud = open_cloud(path)
    results = results_for(cloud.point_count) if results is None else results
    output = path.with_name(name)
    written = write_classified(cloud, lambda first, last: results[first:last], output)
    assert sorted(p.name for p in path.parent.glob(".*")) == [], "no temporary file is left"
    return laspy.read(output), results, written


def assert_kept(before, after, but=()):
    for name in before.point_format.dimension_names:
        if name not in ("classification", *but):
            assert np.array_equal(np.asarray(before[name]), np.asarray(after[name])), name
    assert np.array_equal(before.header.scales, after.header.scales)
    assert np.array_equal(before.header.offsets, after.header.offsets)
    assert after.header.point_format.id == before.header.point_format.id
    assert len(after) == len(before) == after.header.point_count


def assert_new(after, results):
    used = np.asarray(after.withheld) == 0
    assert np.array_equal(after.classification[used], results["classification"][used])
    assert np.array_equal(after["HeightAboveGround"], results["height_above_ground"])
    assert np.array_equal(after["Facade"], results["facade"])
    assert np.array_equal(after["BuildingId"], results["building_id"])
    assert np.array_equal(after["PlaneId"], results["plane_id"])
    assert np.array_equal(after["EdgeLabel"], results["edge"])
    kinds = [after.points.array.dtype[name].str for name in NEW]
    assert kinds == ["<f4", "|u1", "<u4", "<u2", "|u1"]


@pytest.mark.parametrize(
    ("version", "point_format"),
    [("1.1", 0), ("1.1", 1), ("1.2", 2), ("1.2", 3), ("1.3", 1), ("1.3", 4), ("1.3", 5)]
    + [("1.4", point_format) for point_format in range(9)],
)
@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_every_dimension_of_every_format_is_kept(tmp_path, version, point_format, ending):
    before = cloud_files.random_cloud(700, point_format=point_format, version=version)
    after, results, written = classified(cloud_files.saved(before, tmp_path / f"a{ending}"))
    assert_kept(before, after)
    assert_new(after, results)
    assert str(after.header.version) == version
    assert np.array_equal(written.per_class, np.bincount(after.classification, minlength=256))


@pytest.mark.parametrize("point_format", [9, 10])
def test_waveforms_that_laz_may_lose_are_kept_uncompressed(tmp_path, point_format):
    before = cloud_files.random_cloud(700, point_format=point_format)
    path = cloud_files.saved(before, tmp_path / "a.las")
    assert suffix_for(open_cloud(path)) == ".las"
    after, results, _ = classified(path, name="out.las")
    assert_kept(before, after)
    assert_new(after, results)


@pytest.mark.parametrize(("point_format", "minor", "written"), [(1, 0, "1.1"), (3, 1, "1.2")])
def test_the_oldest_version_that_can_be_written_and_has_the_format_is_taken(
    tmp_path, point_format, minor, written
):
    before = cloud_files.random_cloud(point_format=point_format)
    path = cloud_files.patched(cloud_files.saved(before, tmp_path / "a.las"), 25, bytes([minor]))
    after, results, _ = classified(path)
    assert_kept(before, after)
    assert_new(after, results)
    assert str(after.header.version) == written


@pytest.mark.parametrize("point_format", [1, 6])
def test_points_that_the_file_withholds_keep_their_class(tmp_path, point_format):
    before = cloud_files.random_cloud(100, point_format=point_format)
    before.withheld[:] = np.arange(100) < 30
    after, results, _ = classified(cloud_files.saved(before, tmp_path / "a.laz"))
    assert np.array_equal(after.classification[:30], before.classification[:30])
    assert np.array_equal(after.classification[30:], results["classification"][30:])
    assert_kept(before, after)


@pytest.mark.parametrize("point_format", [1, 6])
def test_points_of_no_finished_tile_keep_their_class_and_have_no_height(tmp_path, point_format):
    before = cloud_files.random_cloud(100, point_format=point_format)
    results = results_for(100)
    results["known"][::3] = 0
    after, _, _ = classified(cloud_files.saved(before, tmp_path / "a.laz"), results)
    assert np.array_equal(after.classification[::3], before.classification[::3])
    used = (np.arange(100) % 3 > 0) & (np.asarray(before.withheld) == 0)
    assert np.array_equal(after.classification[used], results["classification"][used])
    assert np.isnan(after["HeightAboveGround"][::3]).all()
    assert_kept(before, after)


def test_heights_go_back_to_the_unit_of_the_file(tmp_path):
    before = cloud_files.with_wkt(
        cloud_files.random_cloud(50, point_format=6, corner=(983000.0, 199000.0, 3.0)), "EPSG:2263"
    )
    after, results, _ = classified(cloud_files.saved(before, tmp_path / "a.laz"))
    assert np.allclose(after["HeightAboveGround"], results["height_above_ground"] * 3937 / 1200, rtol=1e-6)


def test_records_are_kept_byte_for_byte(tmp_path):
    before = cloud_files.with_geo_keys(cloud_files.random_cloud(point_format=3), {1024: 1, 3072: 28992})
    lookup = bytes([6]) + b"Roof-top/eaves\0"
    before.vlrs.append(laspy.VLR("LASF_Spec", 0, "d" * 31, lookup))
    before.vlrs.append(laspy.VLR("me", 7, "", b"\0\1\2"))
    path = cloud_files.saved(before, tmp_path / "a.laz")
    data = path.read_bytes()
    at = data.index(b"me\0\0\0")
    cloud_files.patched(path, at + 20, "Größe".encode("latin-1") + b"\0junk")
    classified(path)
    mine, theirs = (
        [
            (r.user_id, r.record_id, r.head[20:], r.data)
            for r in read_raw_header(p).vlrs
            if r.user_id != b"laszip encoded"
        ]
        for p in (path, tmp_path / "out.laz")
    )
    assert theirs[: len(mine)] == mine
    assert [(user, number) for user, number, *_ in theirs[len(mine) :]] == [(b"LASF_Spec", 4)]


def test_header_fields_are_kept_even_where_they_are_odd(tmp_path):
    path = cloud_files.saved(cloud_files.random_cloud(point_format=1), tmp_path / "a.las")
    cloud_files.patched(path, 26, "Überflug".encode("latin-1").ljust(32, b"\0"))
    cloud_files.patched(path, 90, struct.pack("<2H", 0, 0))
    cloud_files.patched(path, 4, struct.pack("<H", 4711))
    classified(path)
    mine, theirs = (p.read_bytes() for p in (path, tmp_path / "out.laz"))
    assert mine[4:24] == theirs[4:24]
    assert mine[26:94] == theirs[26:94]


def test_counts_for_old_readers_are_there_in_version_1_4(tmp_path):
    before = cloud_files.random_cloud(500, point_format=1, version="1.4")
    classified(cloud_files.saved(before, tmp_path / "a.las"))
    data = (tmp_path / "out.laz").read_bytes()
    count, *by_return = struct.unpack_from("<6I", data, 107)
    assert count == 500
    assert by_return == [int((before.return_number == n).sum()) for n in range(1, 6)]


def test_existing_extra_dimensions_and_their_description_are_kept(tmp_path):
    before = cloud_files.random_cloud(point_format=6)
    before.add_extra_dims(
        [
            laspy.ExtraBytesParams(
                "Reflectance", "i2", "of the target", offsets=[5.0], scales=[0.01], no_data=[-9]
            ),
            laspy.ExtraBytesParams("Normal", "3f4"),
        ]
    )
    random = np.random.default_rng(5)
    before.points.array["Reflectance"] = random.integers(-999, 999, len(before))
    before.points.array["Normal"] = random.normal(size=(len(before), 3))
    path = cloud_files.saved(before, tmp_path / "a.laz")
    after, results, _ = classified(path)
    assert_kept(before, after)
    assert_new(after, results)
    entries = [
        next(r.data for r in read_raw_header(p).vlrs if r.is_a(b"LASF_Spec", 4))
        for p in (path, tmp_path / "out.laz")
    ]
    assert entries[1][: len(entries[0])] == entries[0]


def test_bytes_that_no_record_describes_are_kept(tmp_path):
    before = cloud_files.random_cloud(point_format=1)
    before.add_extra_dims([laspy.ExtraBytesParams("Secret", "u4")])
    before.points.array["Secret"] = np.arange(len(before))
    path = cloud_files.saved(before, tmp_path / "a.las")
    record = next(r for r in read_raw_header(path).vlrs if r.is_a(b"LASF_Spec", 4))
    cloud_files.patched(path, record.start - 54 + 18, struct.pack("<H", 999))
    after, results, _ = classified(path)
    assert np.array_equal(after["ExtraBytes"].reshape(-1, 4).view("<u4").ravel(), np.arange(len(before)))
    assert_new(after, results)


def test_results_of_an_earlier_run_are_written_over(tmp_path):
    path = cloud_files.saved(cloud_files.random_cloud(point_format=6), tmp_path / "a.laz")
    classified(path)
    again, results, _ = classified(tmp_path / "out.laz", results_for(500, seed=9), name="again.laz")
    assert_new(again, results)
    assert list(again.point_format.extra_dimension_names) == list(NEW)


def test_a_dimension_of_the_same_name_and_another_type_gets_a_new_name(tmp_path):
    before = cloud_files.random_cloud(point_format=6)
    before.add_extra_dims(
        [laspy.ExtraBytesParams("HeightAboveGround", "f8"), laspy.ExtraBytesParams("EdgeLabel", "u1")]
    )
    before.HeightAboveGround = np.arange(len(before)) / 7.0
    after, results, _ = classified(cloud_files.saved(before, tmp_path / "a.laz"))
    assert_new(after, results)
    assert np.array_equal(after["HeightAboveGround_1"], before["HeightAboveGround"])


def test_extended_records_are_kept_and_the_copc_index_is_not(tmp_path):
    before = cloud_files.random_cloud(400, point_format=7)
    after, results, _ = classified(cloud_files.saved_copc(before, tmp_path / "a.copc.laz"))
    assert_kept(before, after)
    assert_new(after, results)
    raw = read_raw_header(tmp_path / "out.laz")
    assert not [r for r in raw.vlrs + raw.evlrs if r.user_id == b"copc"]
    plain = cloud_files.random_cloud(400, point_format=7)
    notes = [laspy.VLR("me", number, "note", bytes([number]) * 100_000) for number in (1, 2)]
    plain.evlrs = laspy.vlrs.vlrlist.VLRList(notes)
    after, _, _ = classified(cloud_files.saved(plain, tmp_path / "b.laz"), name="out_b.laz")
    assert_kept(plain, after)
    assert [(r.user_id, r.record_id, r.record_data) for r in after.evlrs] == [
        ("me", number, bytes([number]) * 100_000) for number in (1, 2)
    ]


def test_waveforms_inside_the_file_move_with_it(tmp_path):
    before = cloud_files.random_cloud(200, point_format=4, version="1.3")
    path = cloud_files.saved(before, tmp_path / "a.las")
    waveforms = struct.pack("<2x16sHQ32s", b"LASF_Spec", 65535, 5000, b"") + bytes(range(200)) * 25
    start = path.stat().st_size
    path.write_bytes(path.read_bytes() + waveforms)
    cloud_files.patched(cloud_files.patched(path, 6, struct.pack("<H", 2)), 227, struct.pack("<Q", start))
    after, _, _ = classified(path)
    assert_kept(before, after)
    moved = read_raw_header(tmp_path / "out.laz").waveform_start
    assert (tmp_path / "out.laz").read_bytes()[moved:] == waveforms


@pytest.mark.parametrize(("point_format", "plain"), [(4, 1), (5, 3), (9, 6), (10, 8)])
def test_references_to_waveforms_in_another_file_are_left_out_and_the_rest_is_kept(
    tmp_path, point_format, plain
):
    before = cloud_files.random_cloud(300, point_format=point_format)
    before.add_extra_dim(laspy.ExtraBytesParams("own", "uint16"))
    before.own = np.arange(300)
    before.header.global_encoding.waveform_data_packets_external = True
    before.header.vlrs.append(laspy.VLR("LASF_Spec", 100, "waveform", bytes(26)))
    after, results, written = classified(cloud_files.saved(before, tmp_path / "a.las"))
    assert suffix_for(open_cloud(tmp_path / "a.las")) == ".laz"
    assert after.header.point_format.id == plain
    assert not after.header.global_encoding.waveform_data_packets_external
    assert not any(one.record_id == 100 for one in after.header.vlrs)
    for name in {*laspy.PointFormat(plain).dimension_names, "own"} - {"classification"}:
        assert np.array_equal(np.asarray(before[name]), np.asarray(after[name])), name
    assert_new(after, results)
    assert [one.code for one in written.remarks] == ["waveforms_left_out"]


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_provider_whose_buildings_are_others_is_named(tmp_path, share):
    before = cloud_files.random_cloud(5000, point_format=6)
    before.classification[:], before.withheld[:] = 6, 0
    results = results_for(5000)
    results["classification"] = np.where(np.arange(5000) < share * 5000, 5, 6)
    _, _, written = classified(cloud_files.saved(before, tmp_path / "a.laz"), results)
    assert [one.code for one in written.remarks] == (["other_classes"] if share > 0.2 else [])
    assert all("30 % of its 5,000 points of class 6 (building)" in one.text for one in written.remarks)


def test_points_outside_the_bounds_of_the_header_are_told(tmp_path):
    cloud = cloud_files.random_cloud(5000)
    cloud.x[:200] = 85_050.0  # where a file begins nothing is wrong
    path = cloud_files.saved(cloud, tmp_path / "a.las")
    cloud_files.patched(path, 179, struct.pack("<d", float(cloud.x.max()) - 7.0))
    _, _, written = classified(path)
    assert [one.code for one in written.remarks] == ["header_bounds"]
    assert "up to 7.0 m outside" in written.remarks[0].text


def test_the_same_input_gives_the_same_bytes(tmp_path):
    path = cloud_files.saved(cloud_files.random_cloud(60_000, point_format=6), tmp_path / "a.laz")
    results = results_for(60_000)
    for name in ("one.laz", "two.laz"):
        classified(path, results, name=name)
    assert (tmp_path / "one.laz").read_bytes() == (tmp_path / "two.laz").read_bytes()


def test_an_input_that_fails_leaves_no_output(tmp_path, monkeypatch):
    path = cloud_files.saved(cloud_files.random_cloud(), tmp_path / "a.laz")
    cloud = open_cloud(path)

    def chunks(self, size=0):
        yield from ()
        raise InputError(f"{path}: is truncated: copy it again")

    monkeypatch.setattr(type(cloud), "chunks", chunks)
    with pytest.raises(InputError):
        write_classified(cloud, lambda first, last: None, tmp_path / "out.laz")
    assert [p.name for p in tmp_path.iterdir()] == ["a.laz"]


@pytest.mark.parametrize("allowed", [0, 1000, 30_000])
def test_a_full_disk_gives_one_line_and_leaves_no_output(tmp_path, monkeypatch, allowed):
    path = cloud_files.saved(cloud_files.random_cloud(20_000), tmp_path / "a.laz")
    cloud_files.fill_the_disk(monkeypatch, "out", allowed)
    with pytest.raises(OutputError) as caught:
        classified(path)
    assert str(caught.value).startswith(
        f"{tmp_path / 'out.laz'}: cannot be written (No space left on device): "
    )
    assert "\n" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["a.laz"]


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["lowdensity/lidarhd_792000_6272000_left", "toronto/TO_core_last_zoom"])
def test_real_files_keep_everything(data_folder, tmp_path, name):
    before = laspy.read(data_folder / f"{name}.laz")
    cloud = open_cloud(data_folder / f"{name}.laz")
    results = results_for(cloud.point_count)
    write_classified(cloud, lambda first, last: results[first:last], tmp_path / "out.laz")
    after = laspy.read(tmp_path / "out.laz")
    assert_kept(before, after)
    assert_new(after, results)
