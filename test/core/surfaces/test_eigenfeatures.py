import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidar_buildings.core.neighbours import parallel
from lidar_buildings.core.surfaces import eigenfeatures
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features


def disc(n=4000):
    """Return points spread evenly over a level disc of radius 1 (a sunflower's pattern), its centre first."""
    k = np.arange(n)
    r, angle = np.sqrt((k + 0.5) / n), k * np.pi * (3 - np.sqrt(5))
    spread = np.column_stack([r * np.cos(angle), r * np.sin(angle), np.zeros(n)])
    return np.vstack([np.zeros(3), spread])


def wavy_cloud(n=3000, seed=0):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 20, (n, 2))
    return np.column_stack([xy, np.where(xy[:, 0] > 10, 3.0, 0.4 * xy[:, 0]) + rng.normal(0, 0.05, n)])


DISC = disc()
FOLD = np.where(DISC[:, 1:2] < 0, DISC[:, [0, 2, 1]] * [1, 1, -1], DISC)
#: Values of Gross & Thoennessen (2006); a quarter disc about its diagonal ±45°: across it the variance is
#: 1/4 − 1/(2π), along it 1/4 + 1/(2π) − m².
SHAPES = {
    "plane": (DISC, [1 / 4, 1 / 4, 0]),
    "straight edge": (DISC[DISC[:, 1] >= 0], [1 / 4, 1 / 4 - 16 / (9 * np.pi**2), 0]),
    "corner": (
        DISC[(DISC[:, :2] >= 0).all(axis=1)],
        [1 / 4 - 1 / (2 * np.pi), 1 / 4 + 1 / (2 * np.pi) - 32 / (9 * np.pi**2), 0],
    ),
    "ridge": (FOLD, [1 / 4, 1 / 8, 1 / 8 - 8 / (9 * np.pi**2)]),
}


@pytest.mark.parametrize(("points", "expected"), SHAPES.values(), ids=SHAPES.keys())
def test_dense_shapes_have_the_published_eigenvalues(points, expected):
    assert eigen_features(points, [1.0]).eigenvalues[0] == pytest.approx(expected, abs=0.001)


def brute_force(points, i, radius):
    """Return the neighbours of one point, their eigenvalues and axes from LAPACK."""
    near = points[((points - points[i]) ** 2).sum(axis=1) <= radius**2]
    values, axes = np.linalg.eigh(np.cov(near.T, bias=True).reshape(3, 3))
    return near, values[::-1], axes[:, ::-1]


@pytest.mark.parametrize("radius", [1.0, 2.5, 7.0])
def test_features_are_those_of_the_definition_at_every_radius(radius):
    points = wavy_cloud(600)
    found = eigen_features(points, [radius])
    for i in range(0, 600, 50):
        near, values, axes = brute_force(points, i, radius)
        assert found.n_neighbours[i] == len(near)
        assert found.eigenvalues[i] == pytest.approx(values, abs=1e-12)
        # Two points leave a direction open.
        if values[1] - values[2] > 1e-6:
            assert abs(found.normals[i] @ axes[:, 2]) == pytest.approx(1, abs=1e-9)


def test_features_of_a_facade_are_those_of_the_definition():
    rng = np.random.default_rng(0)
    # Forty metres of wall above a few square metres of ground: columns are taken apart by elevation.
    points = np.column_stack([rng.uniform(0, 6, 3000), rng.normal(0, 0.02, 3000), rng.uniform(0, 40, 3000)])
    found = eigen_features(points, [1.0])
    for i in range(0, 3000, 250):
        near, values, _ = brute_force(points, i, 1.0)
        assert found.n_neighbours[i] == len(near)
        assert found.eigenvalues[i] == pytest.approx(values, abs=1e-12)


def test_neighbours_at_the_very_radius_count_on_a_lattice():
    lattice = np.stack(np.meshgrid(np.arange(30) * 0.1, np.arange(30) * 0.1, [0.0]), axis=-1).reshape(-1, 3)
    for radius in (0.1, 0.2, 0.5):
        square = ((lattice[:, None] - lattice[None]) ** 2).sum(axis=-1)
        expected = (square <= radius**2).sum(axis=1)
        assert eigen_features(lattice, [radius]).n_neighbours.tolist() == expected.tolist()


def entropy_of(values):
    s = np.sqrt(values)
    return -sum(a * np.log(a) for a in np.array([s[0] - s[1], s[1] - s[2], s[2]]) / s[0] if a > 0)


def test_the_chosen_radius_is_the_one_of_least_entropy():
    points, radii = wavy_cloud(), [0.7, 1.0, 1.4, 2.0, 2.8]
    chosen = eigen_features(points, radii, min_neighbours=6)
    each = [eigen_features(points, [radius]) for radius in radii]
    for i in range(0, len(points), 97):
        allowed = [one for one in each if one.n_neighbours[i] >= 6 or one is each[-1]]
        best = min(allowed, key=lambda one: entropy_of(one.eigenvalues[i]))
        assert chosen.radius[i] == pytest.approx(best.radius[i])
        assert chosen.eigenvalues[i] == pytest.approx(best.eigenvalues[i], rel=1e-9)
    assert len(np.unique(chosen.radius)) == len(radii)


def test_radii_that_hold_too_few_points_are_passed_over_but_for_the_largest():
    points = wavy_cloud()
    found = eigen_features(points, [0.3, 1.0, 2.0], min_neighbours=12)
    small = found.radius < 2.0
    assert 0 < small.sum() < len(points)
    assert (found.n_neighbours[small] >= 12).all()
    assert (eigen_features(points, [0.3], min_neighbours=12).radius == 0.3).all()


def test_a_wall_is_vertical_and_a_flat_roof_is_not():
    roof = disc(2000)
    wall = roof[:, [0, 2, 1]]
    assert eigen_features(roof, [1.0]).verticality.max() == pytest.approx(0)
    assert eigen_features(wall, [1.0]).verticality.min() == pytest.approx(1)


COLUMNS = ("eigenvalues", "normals", "radius", "n_neighbours")


def assert_same_bits(found, rows, expected, expected_rows):
    """Compare all that there is of some points."""
    for name in COLUMNS:
        assert np.array_equal(getattr(found, name)[rows], getattr(expected, name)[expected_rows]), name


@settings(max_examples=20)
@given(st.integers(1, 500), st.integers(0, 2**32 - 1))
def test_the_order_of_rows_does_not_change_a_bit(n, seed):
    points = np.repeat(wavy_cloud(n, seed), 1 + seed % 3, axis=0)
    shuffle = np.random.default_rng(seed).permutation(len(points))
    straight = eigen_features(points, [1.0, 1.5, 2.0])
    assert_same_bits(eigen_features(points[shuffle], [1.0, 1.5, 2.0]), slice(None), straight, shuffle)


@pytest.mark.parametrize("n_threads", [1, 2, 7])
@pytest.mark.parametrize("block", [1, 5, 10_000])
def test_neither_threads_nor_blocks_change_a_bit(monkeypatch, n_threads, block):
    points = wavy_cloud()
    expected = eigen_features(points, [1.0, 1.5, 2.0])
    monkeypatch.setattr(eigenfeatures, "CELLS_A_BLOCK", block)
    monkeypatch.setattr(parallel.os, "cpu_count", lambda: n_threads)
    assert_same_bits(eigen_features(points, [1.0, 1.5, 2.0]), slice(None), expected, slice(None))


@settings(max_examples=20)
@given(st.floats(0, 12), st.floats(0, 12), st.floats(4, 10), st.floats(4, 10), st.integers(0, 100))
def test_a_tile_has_the_features_of_the_whole_where_it_holds_all_neighbours(x, y, width, depth, seed):
    points, reach = wavy_cloud(seed=seed), 1.6
    low, high = np.array([x, y]), np.array([x + width, y + depth])
    inside = ((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)
    to_border = np.minimum(points[:, :2] - low, high - points[:, :2]).min(axis=1)
    whole = np.flatnonzero(to_border[inside] > reach)
    tile, radii = eigen_features(points[inside], [0.8, 1.2, reach]), [0.8, 1.2, reach]
    assert_same_bits(tile, whole, eigen_features(points, radii), np.flatnonzero(inside)[whole])


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
        np.array([[1e8, 0, 0], [-1e8, 0, 0]]),
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


def test_points_that_coincide_have_no_shape_however_many():
    found = eigen_features(np.ones((50, 3)), [0.5, 1.0])
    assert not found.eigenvalues.any()
    assert found.n_neighbours.tolist() == [50] * 50
    assert found.radius.tolist() == [1.0] * 50
    assert not np.any([found.linearity, found.planarity, found.scattering])


def test_tenfold_points_have_the_features_of_single_ones():
    points = wavy_cloud(500)
    single = eigen_features(points, [1.0, 2.0], min_neighbours=5)
    tenfold = eigen_features(np.repeat(points, 10, axis=0), [1.0, 2.0], min_neighbours=50)
    assert np.array_equal(tenfold.radius[::10], single.radius)
    assert np.array_equal(tenfold.n_neighbours[::10], 10 * single.n_neighbours)
    assert tenfold.eigenvalues[::10] == pytest.approx(single.eigenvalues, abs=1e-13)


def test_a_plane_without_noise_has_its_exact_normal_and_a_line_is_all_linear():
    rng = np.random.default_rng(0)
    plan = rng.uniform(0, 20, (2000, 2))
    plane = np.column_stack([plan, 0.5 * plan[:, 0] - 0.25 * plan[:, 1] + 7.0])
    found = eigen_features(plane, [1.5, 3.0])
    normal = np.array([-0.5, 0.25, 1.0]) / np.linalg.norm([-0.5, 0.25, 1.0])
    assert found.normals @ normal == pytest.approx(1, abs=1e-12)
    assert found.roughness.max() < 1e-6
    assert found.scattering.max() < 1e-12
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    found = eigen_features(np.arange(100)[:, None] * 0.1 * direction + 5.0, [0.5, 1.0])
    assert found.normals @ direction == pytest.approx(0, abs=1e-9)
    assert found.linearity == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(
    "radii", [[], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0], [np.nan], [np.inf], [1e-200], [1.0, 1e200]]
)
def test_what_cannot_be_described_is_refused_by_name(radii):
    with pytest.raises(ValueError, match="radii"):
        eigen_features(np.zeros((3, 3)), radii)
    with pytest.raises(ValueError, match="min_neighbours = 0"):
        eigen_features(np.zeros((3, 3)), [1.0], min_neighbours=0)
    with pytest.raises(ValueError, match=r"points\[0\]"):
        eigen_features(np.full((3, 3), np.nan), [1.0])
