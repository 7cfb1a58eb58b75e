import numpy as np
import pytest

from lidar_buildings.core.surfaces.intensity import (
    HIGH_ANCHOR,
    IntensityScale,
    normalised_intensity,
    strip_scales,
    valley_between_modes,
)

EVERYTHING = np.ones(20_000, dtype=bool)


def reflectances(seed=0, n_points=20_000):
    random = np.random.default_rng(seed)
    return np.where(
        random.random(n_points) < 0.4,
        random.normal(0.12, 0.02, n_points),
        random.normal(0.45, 0.06, n_points),
    )


@pytest.mark.parametrize(("gain", "offset"), [(250.0, 0.0), (60_000.0, 3000.0), (900.0, 100.0)])
def test_8_and_16_bit_sensors_come_to_the_same_scale(gain, offset):
    reflectance = reflectances()
    strip = np.zeros(len(reflectance), dtype=np.uint16)
    expected = normalised_intensity(reflectance, strip, strip_scales(reflectance, strip, EVERYTHING))
    recorded = np.rint(reflectance * gain + offset)
    found = normalised_intensity(recorded, strip, strip_scales(recorded, strip, EVERYTHING))
    # An 8-bit sensor rounds to about one step of the scale.
    np.testing.assert_allclose(found, expected, atol=2.0)


def test_strips_of_different_gain_and_offset_become_alike():
    reflectance = reflectances()
    strip = (np.arange(len(reflectance)) % 3).astype(np.uint16) + 57138
    recorded = (
        reflectance * np.array([300.0, 900.0, 40_000.0])[strip - 57138]
        + np.array([0, 50, 500])[strip - 57138]
    )
    found = normalised_intensity(recorded, strip, strip_scales(recorded, strip, EVERYTHING))
    road = reflectance < 0.25
    medians = np.array(
        [[np.median(found[(strip == s) & (road == r)]) for s in np.unique(strip)] for r in (0, 1)]
    )
    assert np.ptp(medians, axis=1).max() < 3.0
    assert medians[1].max() < 60 < 120 < medians[0].min()


def test_the_scale_is_anchored_at_two_percentiles_of_whole_pulses():
    intensity = np.concatenate([np.linspace(100.0, 200.0, 10_001), np.full(5000, 3.0)])
    is_single = np.arange(len(intensity)) <= 10_000
    strip = np.zeros(len(intensity), dtype=np.uint16)
    scales = strip_scales(intensity, strip, is_single)
    assert scales == {0: IntensityScale(pytest.approx(101.0), pytest.approx(195.0))}
    found = normalised_intensity(np.array([101.0, 195.0, 3.0, 65_535.0]), strip[:4], scales)
    np.testing.assert_allclose(found, [0.0, HIGH_ANCHOR, 0.0, 255.0], atol=1e-4)


def test_a_strip_of_few_pulses_takes_the_scale_of_all():
    intensity = np.concatenate([np.linspace(100.0, 200.0, 10_001), [150.0]])
    strip = np.array([4] * 10_001 + [5])
    scales = strip_scales(intensity, strip, np.ones(len(strip), dtype=bool))
    assert scales[5].low == pytest.approx(scales[4].low, abs=0.1)


def test_constant_intensity_and_no_whole_pulse_are_dark_throughout():
    intensity, strip = np.full(1000, 77.0), np.zeros(1000, dtype=np.uint16)
    for is_single in (np.ones(1000, dtype=bool), np.zeros(1000, dtype=bool)):
        assert not normalised_intensity(intensity, strip, strip_scales(intensity, strip, is_single)).any()


def test_nothing_is_legal():
    nothing = np.zeros(0)
    assert strip_scales(nothing, nothing.astype(int), nothing.astype(bool)) == {}
    assert len(normalised_intensity(nothing, nothing.astype(int), {})) == 0


def test_the_order_of_the_points_does_not_change_a_scale():
    intensity, strip = np.rint(reflectances() * 500), np.arange(20_000) % 2
    order = np.random.default_rng(1).permutation(20_000)
    assert strip_scales(intensity, strip, EVERYTHING) == strip_scales(
        intensity[order], strip[order], EVERYTHING
    )


def modes(*groups, seed=0):
    random = np.random.default_rng(seed)
    return np.clip(np.concatenate([random.normal(mean, sigma, n) for mean, sigma, n in groups]), 0, 255)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.5, 0.9])
def test_the_valley_lies_between_the_modes_whatever_their_shares(share):
    n = 20_000
    limit = valley_between_modes(modes((55, 12, int(share * n)), (148, 18, int((1 - share) * n))))
    assert 75 < limit < 125


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("n", [1000, 3000, 30_000])
def test_one_mode_has_no_valley(n, seed):
    assert valley_between_modes(modes((110, 25, n), seed=seed)) is None


@pytest.mark.parametrize("seed", range(5))
def test_a_skewed_mode_and_an_even_spread_have_no_valley(seed):
    random = np.random.default_rng(seed)
    assert valley_between_modes(np.clip(random.gamma(4.0, 15.0, 20_000), 0, 255)) is None
    assert valley_between_modes(random.uniform(20.0, 200.0, 20_000)) is None


@pytest.mark.parametrize("values", [[], [7.0], [7.0] * 5000, [0.0] * 5000, [255.0] * 5000])
def test_too_little_and_constant_brightness_have_no_valley(values):
    assert valley_between_modes(np.array(values)) is None
