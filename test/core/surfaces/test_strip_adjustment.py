"""Strips that were shifted by known amounts lie on each other again; what nothing tells stays as it is."""

import numpy as np
import pytest

from lidar_buildings.core.surfaces.strip_adjustment import adjust_strips

SHIFTS = np.array([[0.0, 0.0, 0.0], [0.35, -0.2, 0.12], [-0.3, 0.25, -0.08]])


def surveyed(seed=0, with_roofs=True):
    """Strips of 45 m that overlap by 20 m, over rolling ground with gable roofs in all directions."""
    random = np.random.default_rng(seed)
    points = []
    for number, shift in enumerate(SHIFTS):
        xy = random.uniform((25.0 * number, 0.0), (25.0 * number + 45.0, 50.0), (6000, 2))
        z = 0.3 * np.sin(xy[:, 1] / 15.0)
        for k, middle in enumerate(np.mgrid[10:100:15, 8:50:16].reshape(2, -1).T if with_roofs else ()):
            away, turn = xy - middle, np.array([np.cos(0.7 * k), np.sin(0.7 * k)])
            u, v = away @ turn, away @ (-turn[1], turn[0])
            inside = (np.abs(u) < 6.0) & (np.abs(v) < 5.0)
            z[inside] = 3.0 + 0.7 * (5.0 - np.abs(v[inside]))
        points.append(np.column_stack([xy, z]) + random.normal(0.0, 0.03, (len(xy), 3)) + shift)
    return np.concatenate(points), np.repeat(np.arange(7, 7 + len(SHIFTS)), 6000)


@pytest.mark.parametrize("seed", [0, 1])
def test_known_shifts_are_found_to_a_centimetre_in_height_and_five_in_plan(seed):
    found = adjust_strips(*surveyed(seed))
    left = found.shift + SHIFTS - SHIFTS.mean(axis=0)
    assert np.abs(left[:, 2]).max() < 0.01
    assert np.abs(left[:, :2]).max() < 0.05
    assert found.strips.tolist() == [7, 8, 9]
    assert np.isfinite(found.error).all()
    assert [(one.first, one.second) for one in found.pairs] == [(7, 8), (8, 9)]
    for one in found.pairs:
        true = SHIFTS[one.second - 7, 2] - SHIFTS[one.first - 7, 2]
        assert one.before.height == pytest.approx(true, abs=0.02)
        assert abs(one.after.height) < 0.01
        assert one.after.rms_sloping < 0.06 < one.before.rms_sloping


def test_without_roofs_heights_alone_are_shifted():
    found = adjust_strips(*surveyed(with_roofs=False))
    assert (found.shift[:, :2] == 0.0).all()
    assert np.isinf(found.error[:, 0]).all()
    assert np.abs(found.shift[:, 2] + SHIFTS[:, 2] - SHIFTS[:, 2].mean()).max() < 0.02
    assert found.pairs[0].after.n_sloping == 0


def test_strips_that_overlap_no_other_stay_where_they_are():
    points, strips = surveyed(with_roofs=False)
    apart = points + np.array([200.0, 0.0, 0.0]) * (strips - 7)[:, None]
    found = adjust_strips(apart, strips)
    assert not found.pairs
    assert (found.shift == 0.0).all()
    assert np.isinf(found.error).all()
