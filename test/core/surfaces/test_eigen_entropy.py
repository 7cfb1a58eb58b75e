import numpy as np
import pytest
from numba import njit

from lidar_buildings.core.surfaces.eigenfeatures.entropy import _log, _parts, entropy_of_shape

#: Eigenvalues from a line to a ball, those that make a share 0 or 1 included.
SPECTRA = [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0.5, 0), (1, 0.5, 0.25), (5, 1e-3, 1e-9), (1e-8, 9e-9, 1e-20)]


def of_shares(shares):
    return -sum(a * np.log(a) for a in shares if a > 0)


@pytest.mark.parametrize("values", SPECTRA)
def test_the_entropy_of_dimensionality_is_that_of_line_plane_and_volume(values):
    s1, s2, s3 = np.sqrt(values)
    expected = of_shares(np.array([s1 - s2, s2 - s3, s3]) / s1)
    found = entropy_of_shape(values[0], 0.0, 0.0, values[1], 0.0, values[2])
    # An eigenvalue is known to 1e-16 of the largest one, so σ to 1e-8 of it: a ln a of that is 2e-7.
    assert found == pytest.approx(expected, abs=1e-6)


@njit
def logarithm(share):
    _, x, exponent = _parts(share)
    return _log((x - 1.0) / (x + 1.0), exponent)


def test_the_logarithm_is_exact_over_all_magnitudes():
    for share in np.geomspace(1e-15, 1.0, 200):
        assert logarithm(share) == pytest.approx(np.log(share), abs=3e-14)


def test_a_multiple_of_the_covariance_has_the_same_entropy():
    covariance = np.array([3.0, 0.5, 0.1, 2.0, -0.3, 1.0])
    expected = entropy_of_shape(*covariance)
    assert 0 < expected < np.log(3.0)
    for factor in (1e-12, 7.0, 1e12):
        assert entropy_of_shape(*(factor * covariance)) == pytest.approx(expected, rel=1e-12)


def test_no_spread_at_all_is_never_preferred():
    assert entropy_of_shape(0.0, 0.0, 0.0, 0.0, 0.0, 0.0) == np.inf
