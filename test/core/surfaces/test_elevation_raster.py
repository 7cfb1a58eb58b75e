import numpy as np
import pytest

from lidar_buildings.core.surfaces.elevation_raster import filled


def holes(shape, share, seed=0):
    return np.random.default_rng(seed).random(shape) < share


def test_known_cells_keep_their_value_and_others_stay_between_the_extremes():
    values = np.random.default_rng(0).normal(size=(37, 50))
    known = holes(values.shape, 0.2)
    out = filled(np.where(known, values, np.nan), known)
    np.testing.assert_array_equal(out[known], values[known])
    assert values[known].min() <= out.min()
    assert out.max() <= values[known].max()


def test_a_slope_is_bridged_as_a_slope():
    y, x = np.mgrid[:60, :60].astype(float)
    plane = 0.4 * x - 0.2 * y
    known = (abs(x - 30) > 10) | (abs(y - 30) > 10)
    # 20 cells of 0.45 rise each lie between the sides of the hole.
    np.testing.assert_allclose(filled(plane, known), plane, atol=0.25)


def test_a_window_is_filled_like_the_whole():
    values = np.random.default_rng(0).normal(size=(90, 90)).cumsum(axis=0)
    known = holes(values.shape, 0.4)
    whole = filled(values, known, (5, 8))
    window = filled(values[13:80, 20:77], known[13:80, 20:77], (18, 28))
    np.testing.assert_allclose(window[12:-12, 12:-12], whole[25:68, 32:65], atol=1e-3)


@pytest.mark.parametrize("first", [(0, 0), (-3, 7), (-1, -1)])
@pytest.mark.parametrize("shape", [(1, 1), (1, 20), (20, 1), (2, 2), (2, 3)])
def test_one_known_cell_fills_any_raster(shape, first):
    known = np.zeros(shape, dtype=bool)
    known[-1, -1] = True
    np.testing.assert_array_equal(filled(np.full(shape, 4.0), known, first), np.full(shape, 4.0))


def test_nothing_known_is_refused():
    with pytest.raises(ValueError, match="known"):
        filled(np.zeros((3, 3)), np.zeros((3, 3), dtype=bool))
