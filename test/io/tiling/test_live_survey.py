"""Points of a feed become tiles when the sensor has left them, again when more come, and are never lost."""

import errno
from dataclasses import replace

import numpy as np
import pytest

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.tiling import live_survey, spool
from lidar_buildings.io.tiling.live_survey import CROWDED, THINNED, TOO_MANY, VOXEL, LiveSurvey
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig

SIDE = 40.0
CONFIG = LiveTilingConfig(tile_size=SIDE, buffer=6.0, max_buffer=12.0, leave_after=5.0)
FRAME = MapFrame("EPSG:28992", (80.0, -200.0, 3.0))
T0 = 1_700_000_000_000_000_000


def scan_at(x, y, n_points=300, seed=0, spread=3.0):
    """A scan around a place of the map."""
    random = np.random.default_rng(seed)
    points = random.uniform([x - spread, y - spread, 0.0], [x + spread, y + spread, 5.0], (n_points, 3))
    times = T0 + np.arange(n_points, dtype=np.int64) * 1000
    columns = {"intensity": random.uniform(0, 255, n_points).astype(np.float32)}
    return PlacedScan(points.astype(np.float32).astype(np.float64), times, columns)


@pytest.fixture
def survey(tmp_path):
    return LiveSurvey(CONFIG, FRAME, tmp_path / "feed")


def tiles_of(survey):
    found = []
    while (tile := survey.take()) is not None:
        found.append(tile)
    return found


def first_tile(survey):
    """Take the tile of a first scan, five seconds after it."""
    survey.add(scan_at(20, 20), 0.0)
    survey.tick(5.0)
    (tile,) = tiles_of(survey)
    return tile


def core_of(tiles):
    return np.concatenate([tile.points[tile.buffer == 0] for tile in tiles])


def sorted_rows(points):
    return points[np.lexsort(points.T)]


def test_a_tile_is_ready_when_no_point_has_fallen_into_it_for_a_while(survey):
    survey.add(scan_at(20, 20), 0.0)
    assert not survey.tick(4.9)
    assert survey.tick(5.0)
    (tile,) = tiles_of(survey)
    assert tile.stamp // 1000 == T0 // 1000
    assert tile.point_spacing is not None
    assert tile.frame == FRAME
    np.testing.assert_array_equal(sorted_rows(tile.points), sorted_rows(scan_at(20, 20).points))


def test_points_in_a_tile_that_was_sent_are_given_out_and_no_others(survey):
    first_tile(survey)
    assert not survey.newer
    later = scan_at(20, 20, seed=1)
    survey.add(later, 6.0)
    survey.add(scan_at(100, 20, seed=2), 6.0)
    survey.tick(6.0)
    np.testing.assert_array_equal(np.concatenate(survey.newer), later.points)


def test_a_tile_without_gaps_goes_before_those_that_later_passes_may_fill(survey):
    survey.add(scan_at(20, 20), 0.0)
    x, y = (axis.ravel() for axis in np.mgrid[111.0:169.5:0.9, -9.0:49.5:0.9])
    points = np.column_stack([x, y, np.zeros(len(x))])
    survey.add(PlacedScan(points, np.full(len(x), T0), {}), 1.0)
    survey.tick(9.0)
    middles = [tile.points[tile.buffer == 0][:, :2].mean(axis=0) for tile in tiles_of(survey)]
    assert len(middles) == 10
    np.testing.assert_allclose(middles[0], (140.0, 20.0), atol=1.0)
    np.testing.assert_allclose(middles[1], (20.0, 20.0), atol=1.0, err_msg="of the others the longest left")


def test_points_in_the_buffer_keep_a_tile_waiting(survey):
    survey.add(scan_at(20, 20), 0.0)
    survey.tick(0.0)
    survey.add(scan_at(43, 20, spread=2.0), 4.0)  # of its neighbour, and seen by both
    survey.tick(4.0)
    assert not survey.tick(5.0)
    assert survey.tick(9.0)
    first, second = sorted(tiles_of(survey), key=lambda tile: tile.points[tile.buffer == 0][:, 0].mean())
    assert np.count_nonzero(first.buffer) > 0
    assert len(core_of([first, second])) == 600


def test_a_tile_comes_again_as_the_next_revision_with_all_its_points(survey):
    first = first_tile(survey)
    survey.add(scan_at(20, 20, seed=1), 6.0)
    survey.tick(11.0)
    assert tiles_of(survey) == [], "not while the first is under way"
    survey.finish(first.stamp)
    assert survey.tick(11.1)
    (second,) = tiles_of(survey)
    assert second.stamp == first.stamp + 1
    assert len(second) == 600
    survey.finish(second.stamp)
    assert not survey.tick(1000.0)
    assert survey.n_waiting == 0


def test_what_is_said_once_more_of_an_earlier_revision_does_not_end_the_next_one(survey):
    first = first_tile(survey)
    survey.finish(first.stamp)
    survey.add(scan_at(20, 20, seed=1), 6.0)
    survey.flush()
    assert survey.tick(6.0)
    survey.finish(first.stamp)  # while the next one waits to be taken
    assert not survey.is_flushed
    (second,) = tiles_of(survey)
    survey.finish(first.stamp)  # and while it is under way
    assert not survey.is_flushed
    survey.finish(second.stamp)
    assert survey.is_flushed


@pytest.mark.parametrize(("n_new", "wait"), [(300, 5.0), (10, 5.0), (5, 10.0), (1, 50.0)])
def test_a_tile_waits_longer_to_come_again_where_fewer_than_one_in_a_hundred_points_are_new(
    survey, n_new, wait
):
    survey.add(scan_at(20, 20, n_points=1000 - n_new), 0.0)
    survey.tick(5.0)
    (first,) = tiles_of(survey)
    survey.finish(first.stamp)
    survey.add(scan_at(20, 20, n_points=n_new, seed=1), 6.0)
    assert not survey.tick(6.0 + wait - 0.1)
    assert survey.tick(6.0 + wait + 0.1)
    (again,) = tiles_of(survey)
    assert len(again) == 1000


@pytest.mark.parametrize("is_done", [True, False])
def test_a_tile_that_is_done_is_not_made_again_for_points_near_its_buffer_alone(survey, is_done):
    first = first_tile(survey)
    survey.finish(first.stamp, is_done=is_done)
    survey.add(scan_at(-4, 20, spread=0.5), 6.0)  # within a spool cell of the western buffer, 2 m wide
    survey.flush()
    assert survey.tick(6.0)
    beside, *again = sorted(tiles_of(survey), key=lambda tile: tile.stamp == first.stamp + 1)
    assert [len(tile) for tile in again] == ([] if is_done else [300])
    for tile in (beside, *again):
        survey.finish(tile.stamp)
    assert survey.is_flushed
    assert survey.n_waiting == 0
    survey.add(scan_at(-1, 20, spread=0.5, seed=1), 7.0)
    survey.tick(100.0)
    assert first.stamp + 1 + len(again) in {tile.stamp for tile in tiles_of(survey)}


def test_the_flush_of_a_tile_under_way_that_has_changed_waits_for_its_next_revision(survey):
    first = first_tile(survey)
    survey.add(scan_at(20, 20, seed=1), 6.0)
    survey.flush()
    survey.finish(first.stamp)
    assert not survey.is_flushed
    assert survey.tick(6.0)
    (second,) = tiles_of(survey)
    survey.finish(second.stamp)
    assert survey.is_flushed


def test_a_larger_buffer_brings_more_points_until_there_are_none(survey):
    survey.add(scan_at(20, 20), 0.0)
    survey.add(scan_at(50, 20, spread=1.0), 0.0)  # beyond the first buffer
    survey.tick(5.0)
    tile = min(tiles_of(survey), key=lambda one: one.points[one.buffer == 0][:, 0].mean())
    grown = survey.grown(tile)
    assert len(grown) > len(tile)
    assert survey.grown(grown) is None
    survey.finish(tile.stamp + 1)  # the sender counts a grown one as a revision
    survey.add(scan_at(20, 20, seed=3), 20.0)
    survey.tick(70.0)
    assert 2 in {one.stamp - tile.stamp for one in tiles_of(survey)}


def test_a_tile_that_has_grown_begins_anew_when_points_fall_into_the_wider_buffer(survey):
    survey.add(scan_at(20, 20), 0.0)
    survey.add(scan_at(51, 20, spread=0.8), 0.0)
    survey.tick(5.0)
    tile, other = sorted(tiles_of(survey), key=lambda one: one.points[one.buffer == 0][:, 0].mean())
    grown = survey.grown(tile)
    for stamp in (tile.stamp + 1, other.stamp):
        survey.finish(stamp)
    survey.add(scan_at(51, 20, seed=1, spread=0.8), 6.0)  # beyond its first buffer, within the wider one
    survey.flush()
    survey.tick(6.0)
    again = {one.stamp: one for one in tiles_of(survey)}
    assert again.keys() == {tile.stamp + 2, other.stamp + 1}
    first = again[tile.stamp + 2]
    assert first.bounds == tile.bounds, "as in a feed in which all points had come before"
    assert len(first) == len(tile)
    assert len(survey.grown(first)) == len(grown) + 300


def test_an_interrupted_feed_goes_on_with_what_was_not_done(survey, tmp_path):
    survey.add(scan_at(20, 20), 0.0)
    survey.add(scan_at(140, 20), 0.0)
    survey.add(scan_at(260, 20), 0.0)
    survey.tick(5.0)
    done, under_way, _ = tiles_of(survey)
    survey.finish(done.stamp)
    # nothing is closed: as after SIGKILL; and a record was being written
    with open(tmp_path / "feed" / "points.log", "ab") as file:
        file.write(b"half a record")
    with open(tmp_path / "feed" / "tiles.jsonl", "a") as file:
        file.write('{"tile": [0, 0], "sta')
    second = LiveSurvey(CONFIG, FRAME, tmp_path / "feed")
    assert second.n_points == 900
    assert second.tick(0.0)
    again = tiles_of(second)
    assert len(again) == 2
    stamps = {tile.stamp for tile in again}
    assert done.stamp + 1 not in stamps
    assert under_way.stamp + 1 in stamps, "a later revision: the one before may be done by now"
    second.add(scan_at(20, 20, seed=5), 1.0)
    second.tick(51.0)
    assert [tile.stamp for tile in tiles_of(second)] == [done.stamp + 1]


def test_tiles_are_the_same_after_an_interruption(survey, tmp_path):
    scans = [scan_at(x, y, seed=int(x + y)) for x in (10, 38, 70) for y in (5, 41)]
    for one in scans:
        survey.add(one, 0.0)
    survey.tick(5.0)
    before = {tile.stamp: tile for tile in tiles_of(survey)}
    second = LiveSurvey(CONFIG, FRAME, tmp_path / "feed")
    second.tick(5.0)
    after = {tile.stamp - 1: tile for tile in tiles_of(second)}
    assert before.keys() == after.keys()
    for stamp, tile in before.items():
        np.testing.assert_array_equal(tile.points, after[stamp].points)
        np.testing.assert_array_equal(tile.index, after[stamp].index)
        np.testing.assert_array_equal(tile.buffer, after[stamp].buffer)


@pytest.mark.parametrize("ending", [".log", ".points"])
def test_points_wait_in_memory_while_the_disk_is_full(survey, monkeypatch, ending):
    survey.add(scan_at(20, 20), 0.0)
    survey.tick(0.0)
    write, room = spool.append_records, iter([ending == ".points"])  # cells are written in several pieces

    def full(path, n_before, records):
        if path.suffix == ending and not next(room, False):
            raise OSError(errno.ENOSPC, "No space left on device")
        write(path, n_before, records)

    monkeypatch.setattr(spool, "append_records", full)
    survey.add(scan_at(41, 41, seed=1), 1.0)
    for _ in range(2):
        with pytest.raises(OutputError, match="No space left"):
            survey.tick(1.0)
    monkeypatch.setattr(spool, "append_records", write)
    survey.tick(6.0)
    assert survey.n_points == 600
    assert len(core_of(tiles_of(survey))) == 600


def test_a_tile_that_is_full_takes_no_more_and_the_points_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(live_survey, "_BATCH", 1)
    config = LiveTilingConfig(tile_size=SIDE, buffer=6.0, max_tile_points=1000)
    survey = LiveSurvey(config, FRAME, tmp_path)
    for seed in range(5):
        survey.add(scan_at(20, 20, seed=seed), 0.0)
    survey.add(scan_at(140, 20), 0.0)
    assert survey.left_out[TOO_MANY] == 300
    assert survey.n_points == 1500 - survey.left_out[CROWDED]


def test_of_a_crowded_tile_points_near_others_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(live_survey, "_BATCH", 1)
    config = LiveTilingConfig(tile_size=SIDE, buffer=6.0, max_tile_points=100_000)
    survey = LiveSurvey(config, FRAME, tmp_path)
    for seed in range(60):  # a sensor that stands still: the same wall of 2 x 5 m again and again
        one = scan_at(20, 20, 3000, seed, spread=1.0)
        one.points[:, 0] = 20.0
        survey.add(one, 0.0)
    survey.tick(5.0)
    (tile,) = tiles_of(survey)
    assert survey.n_points == len(tile) < 60_000
    assert survey.n_points + survey.left_out[CROWDED] == 180_000
    assert set(survey.left_out) == {CROWDED}
    voxels = np.unique(np.floor(tile.points / VOXEL), axis=0)
    assert len(voxels) >= 0.9 * (2 / VOXEL) * (5 / VOXEL), "the wall is covered"


@pytest.mark.parametrize("view", ["auto", "street"])
def test_of_points_from_the_street_one_a_voxel_is_kept_from_the_first_on(tmp_path, view):
    survey = LiveSurvey(replace(CONFIG, view=view, street_voxel=0.2), FRAME, tmp_path)
    for seed in range(3):
        one = scan_at(20, 20, 3000, seed, spread=1.0)
        survey.add(one._replace(columns=one.columns | {"view": np.full(3000, View.STREET)}), 0.0)
    survey.tick(5.0)
    (tile,) = tiles_of(survey)
    voxels = np.unique(np.floor(tile.points / 0.2), axis=0)
    assert len(voxels) <= survey.n_points == len(tile) < 1.01 * len(voxels) < 2600, "few are forgotten"
    assert survey.left_out == {THINNED.format(0.2): 9000 - len(tile)}
    assert survey.thinned.startswith(f"{9000 - len(tile):,} of 9,000 points")


def test_from_above_and_with_a_voxel_of_nothing_no_point_is_left_out(tmp_path):
    for name, view, voxel in (("above", "above", 0.2), ("street", "street", 0.0)):
        survey = LiveSurvey(replace(CONFIG, view=view, street_voxel=voxel), FRAME, tmp_path / name)
        survey.add(scan_at(20, 20, 3000, spread=1.0), 0.0)
        survey.tick(5.0)
        assert (survey.n_points, survey.thinned) == (3000, "")


def test_what_a_crowded_tile_keeps_does_not_depend_on_when_points_are_written(tmp_path):
    config = LiveTilingConfig(tile_size=SIDE, buffer=6.0, max_tile_points=100_000)
    kept = []
    for period in (1, 7):
        survey = LiveSurvey(config, FRAME, tmp_path / str(period))
        for seed in range(40):
            survey.add(scan_at(20, 20, 3000, seed, spread=1.0), 0.0)
            if seed % period == 0:
                survey.tick(0.0)
        survey.flush()
        kept.append(np.concatenate(list(survey.records(0))))
    assert len(kept[0]) < 120_000
    np.testing.assert_array_equal(*kept)


def test_reset_forgets_all(survey, tmp_path):
    first_tile(survey)
    survey.clear()
    assert survey.n_points == survey.n_waiting == survey.n_tiles == 0
    survey.add(scan_at(20, 20, seed=1), 6.0)
    survey.tick(11.0)
    (tile,) = tiles_of(survey)
    assert len(tile) == 300
    assert LiveSurvey(CONFIG, FRAME, tmp_path / "feed").n_points == 300
