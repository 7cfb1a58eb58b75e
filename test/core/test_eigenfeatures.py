import numpy as np
import pytest

from lidar_buildings.core import row_blocks
from lidar_buildings.core.eigenfeatures import eigen_features
from lidar_buildings.core.symmetric_eigen import eigenvalues_3x3, smallest_eigenvector_3x3

UPPER = np.triu_indices(3)


def disc(n=4000):
    """Return points spread evenly over a level disc of radius 1 (a sunflower's pattern), its centre first."""
    k = np.arange(n)
    r, angle = np.sqrt((k + 0.5) / n), k * np.pi * (3 - np.sqrt(5))
    spread = np.column_stack([r * np.cos(angle), r * np.sin(angle), np.zeros(n)])
    return np.vstack([np.zeros(3), spread])


def at_centre(points):
    """Return λ/R² of the first point's neighbourhood of radius 1."""
    return eigen_features(points, [1.0]).eigenvalues[0]


def wavy_cloud(n=3000, seed=0):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 20, (n, 2))
    return np.column_stack([xy, np.where(xy[:, 0] > 10, 3.0, 0.4 * xy[:, 0]) + rng.normal(0, 0.05, n)])


def random_covariances():
    rng = np.random.default_rng(0)
    for n, scale in [(3, 1.0), (4, 1e-6), (10, 1e6), (50, 1.0), (50, [1, 1, 1e-4]), (50, [1, 1e-3, 1e-3])]:
        spread = rng.normal(size=(n, 3)) * scale @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
        yield np.cov(spread.T, bias=True)


@pytest.mark.parametrize("covariance", list(random_covariances()))
def test_closed_form_eigenvalues_and_normals_are_those_of_lapack(covariance):
    values, _ = np.linalg.eigh(covariance)
    found = np.array(eigenvalues_3x3(*covariance[UPPER]))
    assert found == pytest.approx(values[::-1], abs=1e-8 * values[2])
    normal = smallest_eigenvector_3x3(*covariance[UPPER])
    assert np.linalg.norm(normal) == pytest.approx(1, abs=1e-12)
    assert normal[2] >= 0
    # Two eigenvalues 1e-6 of the largest apart leave a direction known to some 1e-8 of the matrix.
    assert covariance @ normal == pytest.approx(values[0] * normal, abs=1e-8 * values[2])


@pytest.mark.parametrize(
    ("direction", "expected"),
    [([1, 0, 0], [0, 0, 1]), ([1, 0, 1], [-(0.5**0.5), 0, 0.5**0.5]), ([0, 0, 1], None)],
)
def test_the_normal_of_a_line_is_the_most_upward_one_across_it(direction, expected):
    normal = smallest_eigenvector_3x3(*np.outer(direction, direction).astype(float)[UPPER])
    assert normal @ direction == pytest.approx(0, abs=1e-9)
    if expected:
        assert normal == pytest.approx(expected, abs=1e-9)


def test_no_spread_at_all_gives_a_normal_straight_up():
    assert smallest_eigenvector_3x3(0.0, 0.0, 0.0, 0.0, 0.0, 0.0).tolist() == [0, 0, 1]
    assert smallest_eigenvector_3x3(*np.eye(3)[UPPER]).tolist() == [0, 0, 1]


# The values are those of Gross & Thoennessen (2006).
def test_a_dense_disc_has_the_eigenvalues_of_a_plane():
    assert at_centre(disc()) == pytest.approx([1 / 4, 1 / 4, 0], abs=0.001)


def test_a_dense_half_disc_has_the_eigenvalues_of_a_straight_edge():
    points = disc()
    points = points[points[:, 1] >= 0]
    assert at_centre(points) == pytest.approx([1 / 4, 1 / 4 - 16 / (9 * np.pi**2), 0], abs=0.001)


def test_a_dense_quarter_disc_has_the_eigenvalues_of_a_corner():
    points = disc()
    points = points[(points[:, :2] >= 0).all(axis=1)]
    # About the diagonal ±45° only; across it the variance is 1/4 − 1/(2π), along it 1/4 + 1/(2π) − m².
    along = 1 / 4 + 1 / (2 * np.pi) - 32 / (9 * np.pi**2)
    across = 1 / 4 - 1 / (2 * np.pi)
    assert at_centre(points) == pytest.approx([across, along, 0], abs=0.001)


def test_the_ridge_between_two_walls_has_the_eigenvalues_of_two_planes():
    points = disc()
    folded = points.copy()
    folded[points[:, 1] < 0, 2] = -points[points[:, 1] < 0, 1]
    folded[points[:, 1] < 0, 1] = 0
    assert at_centre(folded) == pytest.approx([1 / 4, 1 / 8, 1 / 8 - 8 / (9 * np.pi**2)], abs=0.001)


def test_a_line_has_a_third():
    line = np.column_stack([np.linspace(-1, 1, 2001), np.zeros((2001, 2))])
    middle = eigen_features(line, [1.0])
    assert middle.eigenvalues[1000] == pytest.approx([1 / 3, 0, 0], abs=0.001)
    assert middle.linearity[1000] == pytest.approx(1, abs=1e-6)


def test_features_are_those_of_the_definition_at_every_radius():
    points = wavy_cloud(600)
    for radius in (1.0, 2.5):
        found = eigen_features(points, [radius])
        for i in range(0, 600, 50):
            near = points[((points - points[i]) ** 2).sum(axis=1) <= radius**2]
            values = np.linalg.eigvalsh(np.cov(near.T, bias=True).reshape(3, 3))[::-1]
            assert found.n_neighbours[i] == len(near)
            assert found.eigenvalues[i] == pytest.approx(values, abs=1e-9)


def entropy_of(values):
    s = np.sqrt(values)
    shares = np.array([s[0] - s[1], s[1] - s[2], s[2]]) / s[0]
    return -sum(a * np.log(a) for a in shares if a > 0)


def test_the_chosen_radius_is_the_one_of_least_entropy():
    points, radii = wavy_cloud(), [0.7, 1.0, 1.4, 2.0, 2.8]
    chosen = eigen_features(points, radii, min_neighbours=4)
    each = [eigen_features(points, [radius]) for radius in radii]
    for i in range(0, len(points), 97):
        allowed = [one for one in each if one.n_neighbours[i] >= 4 or one is each[-1]]
        best = min(allowed, key=lambda one: entropy_of(one.eigenvalues[i]))
        assert chosen.radius[i] == pytest.approx(best.radius[i])
        assert chosen.eigenvalues[i] == pytest.approx(best.eigenvalues[i], rel=1e-9)


def test_shares_of_line_plane_and_volume_add_up_to_one():
    found = eigen_features(wavy_cloud(), [1.5])
    assert found.linearity + found.planarity + found.scattering == pytest.approx(1)
    assert np.all(found.surface_variation <= 1 / 3)


def test_a_wall_is_vertical_and_a_flat_roof_is_not():
    roof = disc(2000)
    wall = roof[:, [0, 2, 1]]
    assert eigen_features(roof, [1.0]).verticality.max() == pytest.approx(0)
    assert eigen_features(wall, [1.0]).verticality.min() == pytest.approx(1)


def test_the_order_of_rows_does_not_change_a_bit():
    points = wavy_cloud()
    shuffle = np.random.default_rng(1).permutation(len(points))
    straight, shuffled = eigen_features(points, [1.0, 2.0]), eigen_features(points[shuffle], [1.0, 2.0])
    assert np.array_equal(straight.eigenvalues[shuffle], shuffled.eigenvalues)
    assert np.array_equal(straight.normals[shuffle], shuffled.normals)


@pytest.mark.parametrize("n_threads", [1, 3])
def test_the_number_of_threads_does_not_change_a_bit(monkeypatch, n_threads):
    points = wavy_cloud()
    expected = eigen_features(points, [1.0, 2.0])
    monkeypatch.setattr(row_blocks, "BLOCK", 100)
    monkeypatch.setattr(row_blocks.os, "cpu_count", lambda: n_threads)
    found = eigen_features(points, [1.0, 2.0])
    assert np.array_equal(found.eigenvalues, expected.eigenvalues)
    assert np.array_equal(found.normals, expected.normals)


def test_features_do_not_lose_digits_far_from_the_origin():
    points = wavy_cloud()
    # 2^20 m is exact in binary: the differences stay the same to the last bit.
    shifted = np.round(points * 1024) / 1024
    found = eigen_features(shifted + np.array([2.0**20, -(2.0**20), 0]), [1.0])
    assert np.abs(found.eigenvalues - eigen_features(shifted, [1.0]).eigenvalues).max() < 1e-12


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((1, 3)),
        np.ones((6000, 3)),
        np.arange(30.0)[:, None] * [1, 2, 3],
        np.array([[1e9, 0, 0], [-1e9, 0, 0]]),
    ],
    ids=["empty", "single", "identical", "collinear", "far apart"],
)
def test_degenerate_clouds_give_finite_features(points):
    found = eigen_features(points, [0.5, 1.0, 10.0])
    assert len(found.radius) == len(points)
    for values in (found.eigenvalues, found.normals, found.linearity, found.planarity):
        assert np.isfinite(values).all()
    assert np.linalg.norm(found.normals, axis=1) == pytest.approx(1)


def test_an_extreme_density_is_thinned_evenly():
    points = disc(60_000)
    points = points[points[:, 1] >= 0]
    found = eigen_features(points[::10], [1.0])
    thinned = eigen_features(points, [1.0])
    assert thinned.n_neighbours[0] < 5000 < len(points)
    assert thinned.eigenvalues[0] == pytest.approx(found.eigenvalues[0], abs=0.005)


@pytest.mark.parametrize("radii", [[], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0], [np.nan]])
def test_radii_that_do_not_rise_are_refused_by_name(radii):
    with pytest.raises(ValueError, match="radii"):
        eigen_features(np.zeros((3, 3)), radii)
