"""Times of points, as drivers write them: what they mean is decided for all scans of a topic."""

import numpy as np
import pytest

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.scans.point_times import (
    COARSE_TIMES,
    N_SCANS,
    OTHER_CLOCK,
    ScanTimes,
    TopicTimes,
    read_times,
)

STAMP = 1_700_000_000_123_456_789
SPAN = np.linspace(0.0, 0.1, 11)
#: What drivers write of a scan that begins at a stamp [ns], by (field, how).
DRIVERS = {
    "velodyne": lambda stamp: SPAN.astype(np.float32),
    "velodyne, counted back": lambda stamp: (SPAN - 0.1).astype(np.float32),
    "ouster": lambda stamp: np.rint(SPAN * 1e9).astype(np.uint32),
    "hesai": lambda stamp: stamp * 1e-9 + SPAN,
    "livox": lambda stamp: stamp + SPAN * 1e9,
    "integers": lambda stamp: (stamp + np.rint(SPAN * 1e9)).astype(np.int64),
    "microseconds": lambda stamp: (stamp // 1000 + np.rint(SPAN * 1e6)).astype(np.uint64),
    "milliseconds of a scan": lambda stamp: (SPAN * 1e3).astype(np.float32),
    "microseconds of a scan": lambda stamp: (SPAN * 1e6).astype(np.float32),
}


def scans_of(driver, n, between=0.1, first=STAMP):
    stamps = first + np.rint(np.arange(n) * between * 1e9).astype(np.int64)
    return [ScanTimes(DRIVERS[driver](stamp), int(stamp)) for stamp in stamps]


@pytest.mark.parametrize("n_scans", [1, 2, 5])
@pytest.mark.parametrize("driver", DRIVERS)
def test_every_driver_is_understood(driver, n_scans):
    scans = scans_of(driver, n_scans)
    reading = read_times("time", scans)
    for scan in scans:
        times, is_own = reading.times(scan)
        assert is_own.all()
        begin = -0.1 if "back" in driver else 0.0
        np.testing.assert_allclose((times[[0, -1]] - scan.stamp) / 1e9, [begin, begin + 0.1], atol=2e-6)


@pytest.mark.parametrize("kind", [np.float32, np.uint32])
@pytest.mark.parametrize("unit", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("length", [0.00133, 0.1, 1.0])
def test_the_time_from_scan_to_scan_tells_the_unit(kind, unit, length):
    if kind is np.uint32 and length / unit < 100:
        pytest.skip("whole numbers too coarse for the scan")
    values = (np.linspace(0.0, length, 50) / unit).astype(kind)
    scans = [ScanTimes(values, STAMP + round(k * length * 1e9)) for k in range(5)]
    assert read_times("t", scans).seconds == unit


@pytest.mark.parametrize("share", [0.001, 0.01, 0.1, 0.2])
@pytest.mark.parametrize("wrong", [0.0, 1e9, -5.0, 0.7, 4e18])
@pytest.mark.parametrize("driver", ["velodyne", "hesai", "ouster", "integers"])
def test_wrong_times_of_some_points_change_nothing_of_the_others(driver, wrong, share):
    random = np.random.default_rng(1)
    right = scans_of(driver, 15)
    topic, found = TopicTimes("t", "auto"), []
    for k, scan in enumerate(right):
        values = np.repeat(scan.values, 100)
        if k % 3 == 0:
            is_wrong = random.random(len(values)) < share
            value = wrong * (1e9 if driver == "ouster" and abs(wrong) < 10 else 1)
            kind = values.dtype
            limits = np.iinfo(kind) if kind.kind in "iu" else None
            values[is_wrong] = (
                value if limits is None else min(max(value, limits.min), float(limits.max // 2))
            )
        found += topic.take(k, ScanTimes(values, scan.stamp))
    found += topic.rest()
    assert [one.scan for one in found] == list(range(15))
    for one, scan in zip(found, right, strict=True):
        truth = np.repeat(SPAN, 100)
        off = np.abs((one.times - scan.stamp) / 1e9 - truth)
        assert one.is_own.mean() > 0.999 - 1.5 * share
        # a wrong time that could be one of the scan is not told from others
        assert np.percentile(off[one.is_own], 75) < 1e-5
        assert off[one.is_own].max() < 0.21


def test_a_unit_that_is_given_counts():
    times, _ = read_times("time", [ScanTimes(np.array([0.0, 1.0]), STAMP)], "ms").times(
        ScanTimes(np.array([0.0, 1.0]), STAMP)
    )
    assert (times - STAMP).tolist() == [0, 1_000_000]


def test_where_no_time_is_told_there_is_none():
    for values in (np.zeros(3, np.uint32), np.zeros(0)):
        reading = read_times("t", [ScanTimes(values, STAMP)])
        assert reading.times(ScanTimes(values, STAMP))[0].tolist() == [STAMP] * len(values)


def test_a_time_since_1970_in_single_precision_is_none():
    reading = read_times("time", [ScanTimes((STAMP * 1e-9 + SPAN).astype(np.float32), STAMP)])
    assert (reading.seconds, reading.doubt) == (0.0, COARSE_TIMES)


@pytest.mark.parametrize("ahead", [37.0, -18.0, 37.0 - 1_700_000_000.0, 4321.4])
def test_a_clock_of_its_own_is_set_by_the_stamps(ahead):
    random = np.random.default_rng(0)
    scans = []
    for k in range(5):
        begin = STAMP / 1e9 + 0.1 * k
        late = round(random.uniform(0.0, 0.02) * 1e9)
        scans.append(ScanTimes(begin + ahead + SPAN, round(begin * 1e9) + late))
    reading = read_times("timestamp", scans)
    assert OTHER_CLOCK.split("{")[0] in reading.doubt
    steps = np.diff([reading.times(one)[0][0] for one in scans]) / 1e9
    np.testing.assert_allclose(steps, 0.1, atol=1e-5), "not as the stamps, which are late by turns"
    is_whole = ahead == round(ahead)
    np.testing.assert_allclose(
        (reading.times(scans[0])[0][0] - STAMP) / 1e9, 0.0, atol=1e-5 if is_whole else 0.03
    )


def test_times_that_no_unit_makes_a_scans_are_named():
    topic = TopicTimes("time", "s")
    for k in range(N_SCANS - 1):
        topic.take(k, ScanTimes(np.full(5, 7e3), STAMP + k))
    with pytest.raises(MessageError, match="field time holds times of about 7000"):
        topic.take(N_SCANS, ScanTimes(np.full(5, 7e3), STAMP + N_SCANS))


def test_a_driver_that_is_started_anew_is_understood_anew():
    topic, found = TopicTimes("t", "auto"), []
    for k, scan in enumerate([*scans_of("velodyne", 8), *scans_of("hesai", 8, first=STAMP + 5_000_000_000)]):
        found += topic.take(k, scan)
    assert [one.scan for one in found] == list(range(16))
    assert all(one.is_own.all() for one in found)
    assert found[-1].times[-1] == pytest.approx(STAMP + 5_800_000_000, abs=2_000)
