import numpy as np
import pytest
from numba import njit

from lidar_buildings.core.surfaces.symmetric_eigen import eigenvalues_3x3, values_and_normal

UPPER = np.triu_indices(3)
#: Eigenvalues of all kinds: separate, a double one at either end, all the same, one, two or three of them 0.
SPECTRA = [
    (3.0, 2.0, 1.0),
    (1.0, 1e-3, 1e-6),
    (1.0, 1.0, 0.2),
    (1.0, 0.2, 0.2),
    (1.0, 1.0, 1.0),
    (1.0, 0.7, 0.0),
    (1.0, 1.0, 0.0),
    (1.0, 0.0, 0.0),
    (1.0, 1.0 - 1e-7, 1e-9),
    (1.0, 1e-9, 1e-9 - 1e-16),
]


def matrices(scales=(1e-12, 1.0, 1e12)):
    """Return matrices of these eigenvalues, turned in many ways."""
    rng = np.random.default_rng(0)
    for spectrum in SPECTRA:
        for scale in scales:
            for _ in range(20):
                turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
                matrix = turn @ np.diag(spectrum) @ turn.T * scale
                yield (matrix + matrix.T) / 2


@njit
def axes_of_many(upper):
    """Return what a loop of vector instructions finds."""
    found = np.empty((len(upper), 6))
    for i in range(len(upper)):
        m = upper[i]
        found[i] = np.array(values_and_normal(m[0], m[1], m[2], m[3], m[4], m[5]))
    return found


def test_eigenvalues_are_those_of_lapack_to_rounding_with_axes():
    every = np.array(list(matrices()))
    values = np.linalg.eigvalsh(every)[:, ::-1]
    found = axes_of_many(every[:, UPPER[0], UPPER[1]])[:, :3]
    assert (np.abs(found - values).max(axis=1) <= 1e-14 * values[:, 0]).all()
    assert (found >= 0).all()
    assert (np.diff(found, axis=1) <= 0).all()


def test_eigenvalues_alone_are_less_exact_for_double_ones():
    for matrix in matrices():
        values = np.linalg.eigvalsh(matrix)[::-1]
        assert eigenvalues_3x3(*matrix[UPPER]) == pytest.approx(values, abs=3e-8 * values[0])


def test_normals_are_unit_vectors_that_the_matrix_only_stretches():
    every = np.array(list(matrices()))
    found = axes_of_many(every[:, UPPER[0], UPPER[1]])
    values, normals = found[:, :3], found[:, 3:]
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1, abs=1e-12)
    assert (normals[:, 2] >= 0).all()
    off = np.linalg.norm(np.einsum("nij,nj->ni", every, normals) - values[:, 2:] * normals, axis=1)
    # Eigenvalues 1e-12 of their sum apart count as one.
    assert (off <= 1e-11 * values[:, 0]).all()


@pytest.mark.parametrize(
    ("direction", "normal"),
    [([1, 0, 0], [0, 0, 1]), ([1, 0, 1], [-(0.5**0.5), 0, 0.5**0.5]), ([0, 0, 1], None)],
)
def test_the_normal_of_a_line_is_the_most_upward_one_across_it(direction, normal):
    found = np.array(values_and_normal(*np.outer(direction, direction).astype(float)[UPPER]))[3:]
    assert found @ direction == pytest.approx(0, abs=1e-9)
    if normal:
        assert found == pytest.approx(normal, abs=1e-9)


def test_a_round_disc_has_its_normal():
    normal = np.array([0.6, 0.0, 0.8])
    found = values_and_normal(*(np.eye(3) - np.outer(normal, normal))[UPPER])
    assert found[3:] == pytest.approx(normal, abs=1e-9)


@pytest.mark.parametrize("size", [0.0, 1.0, 1e-300])
def test_no_direction_at_all_gives_a_normal_straight_up(size):
    found = values_and_normal(*(size * np.eye(3))[UPPER])
    assert found[:3] == pytest.approx([size] * 3)
    assert found[3:] == (0, 0, 1)
