"""A track is laid where positions say that it was, whatever some of them say."""

import numpy as np
import pytest

from lidar_buildings.core.scans.track_fit import fit_track

#: Three flight lines of 150 m, 25 m apart.
LINES = np.array([[abs(150 - k % 300), 25 * (k // 150), 35.0] for k in range(0, 450, 3)])
SHIFT = np.array([1000.0, 2000.0, 5.0])


def seen(track, degrees, noise=0.0, memory=0.0, seed=0):
    """Positions of a turned track; an error may keep so much of the one before."""
    random = np.random.default_rng(seed)
    errors = random.normal(0.0, noise, track.shape) * np.sqrt(1.0 - memory**2)
    errors[0] /= np.sqrt(1.0 - memory**2)
    for k in range(1, len(errors)):
        errors[k] += memory * errors[k - 1]
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return track @ [[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]] + SHIFT + errors


@pytest.mark.parametrize("degrees", [-170.0, -40.0, 1.8, 90.0])
def test_a_yaw_that_shows_is_found(degrees):
    fit = fit_track(LINES, seen(LINES, degrees, noise=0.02), np.ones(len(LINES)))
    assert np.degrees(fit.yaw) == pytest.approx(degrees, abs=0.02)
    np.testing.assert_allclose(fit.shift, SHIFT, atol=0.03)


@pytest.mark.parametrize("seed", range(10))
def test_errors_that_follow_one_another_show_no_yaw(seed):
    fit = fit_track(LINES, seen(LINES, 0.0, noise=2.0, memory=0.98, seed=seed), np.ones(len(LINES)))
    assert fit.yaw == 0.0


def test_where_a_track_stood_long_counts_no_more_than_where_it_moved():
    track = np.concatenate([np.repeat(LINES[:1], 600, axis=0), LINES])
    positions = seen(track, -120.0, noise=1.5)
    positions[:600] += [60.0, -40.0, 30.0]  # a receiver that has just begun
    fit = fit_track(track, positions, np.ones(len(track)))
    assert np.degrees(fit.yaw) == pytest.approx(-120.0, abs=0.6)
    assert not fit.is_used[:600].any()


def test_too_little_motion_tells_no_yaw():
    track = 0.02 * LINES
    fit = fit_track(track, seen(track, 30.0, noise=1.5), np.ones(len(track)))
    assert (fit.yaw, fit.tells_yaw) == (0.0, False)
    assert not fit_track(LINES[:1], seen(LINES[:1], 0.0), np.ones(1)).tells_yaw


def test_good_positions_count_more_than_bad_ones():
    positions, sigma = seen(LINES, 20.0), np.full(len(LINES), 0.02)
    sigma[::2] = 5.0
    positions[::2] += np.random.default_rng(0).normal(0.0, 5.0, (75, 3))
    fit = fit_track(LINES, positions, sigma)
    np.testing.assert_allclose(fit.shift[:2], SHIFT[:2], atol=0.05)
