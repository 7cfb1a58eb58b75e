import numpy as np
import pytest
from scipy import ndimage

from lidar_buildings.core.surfaces.morphology import eroded, opened


def disc(radius):
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return x * x + y * y <= radius * radius


def surface(shape=(40, 53), seed=0):
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize("radius", [0, 1, 2, 5, 18, 40])
def test_erosion_by_a_disc_is_that_of_scipy(radius):
    padded = np.pad(surface(), radius, constant_values=np.inf)
    expected = ndimage.grey_erosion(padded, footprint=disc(radius))
    inner = (slice(radius, radius + 40), slice(radius, radius + 53))
    np.testing.assert_array_equal(eroded(surface(), radius), expected[inner])


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1)])
def test_rasters_narrower_than_the_disc_have_their_minimum_everywhere(shape):
    values = surface(shape)
    np.testing.assert_array_equal(eroded(values, 20), np.full(shape, values.min()))
    np.testing.assert_array_equal(opened(values, 20), np.full(shape, values.min()))


def test_an_opening_is_nowhere_above_and_opening_again_changes_nothing():
    values = surface()
    once = opened(values, 3)
    assert (once <= values).all()
    np.testing.assert_array_equal(opened(once, 3), once)


def test_an_opening_leaves_a_slope_and_cuts_off_what_is_narrower_than_the_disc():
    y, x = np.mgrid[:30, :60].astype(float)
    slope = 0.5 * x
    box = slope + 4.0 * ((abs(x - 20) < 3) & (abs(y - 15) < 6))
    after = opened(box, 7)
    # The disc rests on the slope above the box: 3 cells on it is 1.5 higher.
    assert (box - after)[15, 20] == 2.5
    np.testing.assert_array_equal(opened(slope, 7)[:, :50], slope[:, :50])


def test_unknown_cells_do_not_count():
    values = surface()
    unknown = np.random.default_rng(1).random(values.shape) < 0.5
    after = opened(np.where(unknown, np.inf, values), 4)
    assert (after[~unknown] <= values[~unknown]).all()
    assert np.isinf(opened(np.full((5, 5), np.inf), 2)).all()
