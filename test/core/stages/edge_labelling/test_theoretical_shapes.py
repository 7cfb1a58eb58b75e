import numpy as np
import pytest

from lidar_buildings.core.stages.edge_labelling.labelling import SHAPES, discriminant_edges, nearest_shapes
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features

#: Steps of the integration along a radius, and round a full turn.
N_STEPS = 400
#: Santos and others, Table 1: λ1, λ2, λ3, L, P of three points on edges of a cube and three on its faces.
TABLE_1 = np.array(
    [
        [0.26, 0.12, 0.05, 0.54, 0.27],
        [0.23, 0.11, 0.00, 0.52, 0.43],
        [0.25, 0.13, 0.02, 0.48, 0.44],
        [0.24, 0.24, 0.00, 0.00, 1.00],
        [0.26, 0.25, 0.02, 0.04, 0.88],
        [0.23, 0.22, 0.01, 0.04, 0.91],
    ]
)
#: Eigenvalues and L, P of the ideal ridge and the ideal plane.
RIDGE = (1 / 4, 1 / 8, 1 / 8 - 8 / (9 * np.pi**2))
PLANE = (1 / 4, 1 / 4, 0.0)


def segment(first, last):
    """Integrate along x: points and weights."""
    x = first + (np.arange(N_STEPS) + 0.5) / N_STEPS * (last - first)
    return np.column_stack([x, 0 * x, 0 * x]), np.ones(N_STEPS)


def sector(angle, u=(1.0, 0, 0), v=(0.0, 1, 0)):
    """Integrate over the part of the unit disc from direction u through an angle towards v."""
    r = (np.arange(N_STEPS) + 0.5) / N_STEPS
    turn = (np.arange(N_STEPS) + 0.5) / N_STEPS * angle
    radius, turn = (grid.ravel() for grid in np.meshgrid(r, turn))
    return radius[:, None] * (np.outer(np.cos(turn), u) + np.outer(np.sin(turn), v)), radius


def together(*parts):
    return np.vstack([points for points, _ in parts]), np.concatenate([weight for _, weight in parts])


X, Y, Z = np.eye(3)
INTEGRALS = {
    "isolated point": lambda: (np.zeros((1, 3)), np.ones(1)),
    "end of a line": lambda: segment(0.0, 1.0),
    "line": lambda: segment(-1.0, 1.0),
    "half plane": lambda: sector(np.pi),
    "quarter plane": lambda: sector(np.pi / 2),
    "plane": lambda: sector(2 * np.pi),
    # The ridge is the y axis.
    "two planes": lambda: together(sector(np.pi, -Y, X), sector(np.pi, -Y, -Z)),
    "three planes": lambda: together(
        sector(np.pi / 2, X, Y), sector(np.pi / 2, Y, Z), sector(np.pi / 2, Z, X)
    ),
}


def eigenvalues_of(points, weight):
    mean = np.average(points, axis=0, weights=weight)
    return np.linalg.eigvalsh(
        np.cov(points.T, aweights=weight, bias=True) if len(points) > 1 else np.zeros((3, 3))
    )[::-1], mean


@pytest.mark.parametrize("shape", SHAPES, ids=[shape.name for shape in SHAPES])
def test_each_shape_has_the_eigenvalues_of_its_integral(shape):
    found, _ = eigenvalues_of(*INTEGRALS[shape.name]())
    assert np.abs(found - shape.eigenvalues).max() < 1e-4


def test_the_published_values_are_those_of_the_shapes():
    # As Gross and Thoennessen print them, as far as the notes on the paper carry them.
    table = {shape.name: shape.eigenvalues for shape in SHAPES}
    assert table["half plane"] == pytest.approx((0.25, 0.0699, 0.0), abs=5e-5)
    assert table["quarter plane"] == pytest.approx((0.0908, 0.0489, 0.0), abs=1e-4)
    assert table["two planes"] == pytest.approx((0.25, 0.125, 0.0349), abs=5e-5)


def test_each_shape_is_nearest_to_itself_and_its_group_that_of_the_paper():
    eigenvalues = np.array([shape.eigenvalues for shape in SHAPES])
    assert nearest_shapes(eigenvalues).tolist() == list(range(8))
    edges = {shape.name for shape, edge in zip(SHAPES, discriminant_edges(eigenvalues), strict=True) if edge}
    assert edges == {"line", "half plane", "quarter plane", "two planes"}


def cube_and_six_points(n=60):
    """
    Return a densely sampled cube, of n steps a side, and the rows of the six points of the paper's Figure 2.

    Three lie on edges, well away from the corners; three on faces, away from the edges.
    """
    step = np.arange(n + 1.0)
    u, v = (grid.ravel() for grid in np.meshgrid(step, step))
    faces = [
        np.column_stack(np.roll([0 * u + side, u, v], axis, axis=0)) for axis in range(3) for side in (0.0, n)
    ]
    points = np.unique(np.vstack(faces), axis=0)
    half, third = n // 2, n // 3
    six = [(0, half, n), (half, 0, n), (0, 0, third), (half, half, n), (0, half, third), (half, 0, half)]
    rows = [int(np.flatnonzero((points == point).all(axis=1))[0]) for point in np.array(six, dtype=float)]
    return points, rows


@pytest.mark.parametrize("point", range(6))
def test_a_densely_sampled_cube_reproduces_table_1(point):
    points, rows = cube_and_six_points()
    radius = 15.0
    found = eigen_features(points, [radius])
    row = rows[point]
    normalised = found.eigenvalues[row] / radius**2
    theory = RIDGE if point < 3 else PLANE
    assert np.abs(normalised - theory).max() < 0.03
    linearity, planarity = (theory[0] - theory[1]) / theory[0], (theory[1] - theory[2]) / theory[0]
    assert found.linearity[row] == pytest.approx(linearity, abs=0.03)
    assert found.planarity[row] == pytest.approx(planarity, abs=0.03)
    # The paper's own cube has noise: its eigenvalues are off the theory by up to 0.035, its P by 0.13.
    assert np.abs(normalised - TABLE_1[point, :3]).max() < 0.04
    assert found.linearity[row] == pytest.approx(TABLE_1[point, 3], abs=0.05)
    assert found.planarity[row] == pytest.approx(TABLE_1[point, 4], abs=0.13)
    assert discriminant_edges(normalised[None])[0] == (point < 3)
