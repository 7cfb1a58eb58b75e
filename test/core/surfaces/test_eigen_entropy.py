import numpy as np
import pytest

from lidar_buildings.core.surfaces.eigenfeatures.entropy import entropy_of_shape

#: Eigenvalues from a line to a ball, those that make a share 0 or 1 included.
SPECTRA = [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0.5, 0), (1, 0.5, 0.25), (5, 1e-3, 1e-9), (1e-8, 9e-9, 1e-20)]


def of_shares(shares):
    return -sum(a * np.log(a) for a in shares if a > 0)


@pytest.mark.parametrize("values", SPECTRA)
def test_the_entropy_of_dimensionality_is_that_of_line_plane_and_volume(values):
    s1, s2, s3 = np.sqrt(values)
    expected = of_shares(np.array([s1 - s2, s2 - s3, s3]) / s1)
    found = entropy_of_shape(True, values[0], 0.0, 0.0, values[1], 0.0, values[2])
    # An eigenvalue is known to 1e-16 of the largest one, so σ to 1e-8 of it: a ln a of that is 2e-7.
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("values", SPECTRA)
def test_the_eigenentropy_is_that_of_the_shares_of_variance(values):
    expected = of_shares(np.array(values) / sum(values))
    found = entropy_of_shape(False, values[0], 0.0, 0.0, values[1], 0.0, values[2])
    assert found == pytest.approx(expected, abs=1e-7)


def test_the_logarithm_is_exact_over_all_magnitudes():
    for share in np.geomspace(1e-15, 0.2, 200):
        values = (0.6, 0.4 - share, share)
        found = entropy_of_shape(False, values[0], 0.0, 0.0, values[1], 0.0, values[2])
        assert found == pytest.approx(of_shares(values), abs=3e-14)


@pytest.mark.parametrize("dimensionality", [True, False])
def test_a_multiple_of_the_covariance_has_the_same_entropy(dimensionality):
    covariance = np.array([3.0, 0.5, 0.1, 2.0, -0.3, 1.0])
    expected = entropy_of_shape(dimensionality, *covariance)
    assert 0 < expected < np.log(3.0)
    for factor in (1e-12, 7.0, 1e12):
        assert entropy_of_shape(dimensionality, *(factor * covariance)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dimensionality", [True, False])
def test_no_spread_at_all_is_never_preferred(dimensionality):
    assert entropy_of_shape(dimensionality, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) == np.inf
