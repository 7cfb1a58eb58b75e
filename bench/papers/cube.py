"""The cube of Santos, Galo and others: Table 1, Figure 2 (its points) and Figure 3 (its two clusters)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.papers.pages import markdown
from lidar_buildings.core.stages.edge_labelling.clusters import (
    eigenvalues_by_area,
    in_second,
    metric_of,
    two_means,
)
from lidar_buildings.core.surfaces.eigenfeatures import EigenFeatures, eigen_features

#: Side of the cube, spacing of the points on its faces, their noise, and the radius of the spheres [m].
SIDE, SPACING, NOISE, RADIUS = 1.0, 0.02, 0.003, 0.15
#: The paper's points by number: where they lie here, and λ1, λ2, λ3, L, P as published. 1 to 3 are on edges.
PUBLISHED = {
    1: ((0.5, 0.0, 1.0), (0.26, 0.12, 0.05, 0.54, 0.27)),
    2: ((0.0, 0.5, 1.0), (0.23, 0.11, 0.00, 0.52, 0.43)),
    3: ((0.0, 0.0, 0.5), (0.25, 0.13, 0.02, 0.48, 0.44)),
    4: ((0.5, 0.5, 1.0), (0.24, 0.24, 0.00, 0.00, 1.00)),
    5: ((0.5, 0.0, 0.5), (0.26, 0.25, 0.02, 0.04, 0.88)),
    6: ((0.0, 0.5, 0.5), (0.23, 0.22, 0.01, 0.04, 0.91)),
}


def cube_points() -> NDArray[np.float64]:
    """Return points on the six faces of a cube, shape (n_points, 3) [m]."""
    places = np.arange(0.5 * SPACING, SIDE, SPACING)
    u, v = (one.ravel() for one in np.meshgrid(places, places))
    faces = [
        np.insert(np.column_stack((u, v)), axis, level, axis=1) for axis in range(3) for level in (0.0, SIDE)
    ]
    return np.concatenate(faces) + np.random.default_rng(0).normal(0.0, NOISE, (6 * len(u), 3))


def cube_features(points: NDArray[np.float64]) -> EigenFeatures:
    """Return the principal components of every point's sphere."""
    return eigen_features(points, [RADIUS], min_neighbours=3)


def rows_of(points: NDArray[np.float64], found: EigenFeatures) -> NDArray[np.float64]:
    """Return λ1, λ2, λ3 [R²], L and P of the points nearest to the paper's, shape (6, 5)."""
    chosen = [int(np.argmin(((points - place) ** 2).sum(axis=1))) for place, _ in PUBLISHED.values()]
    measures = np.column_stack((eigenvalues_by_area(found), found.linearity, found.planarity))
    return measures[chosen]


def table_1() -> str:
    """Return the paper's Table 1 beside ours."""
    points = cube_points()
    ours = rows_of(points, cube_features(points))
    rows = []
    for (number, (_, paper)), mine in zip(PUBLISHED.items(), ours, strict=True):
        both = [f"{theirs:.2f} / {own:.2f}" for theirs, own in zip(paper, mine, strict=True)]
        rows.append(["edge" if number <= 3 else "non-edge", str(number), *both])
    return markdown(("class", "point", "λ1 paper / ours", "λ2", "λ3", "L", "P"), rows)


def draw(folder: Path) -> None:
    """Draw Figures 2 and 3 into a folder."""
    from bench.common.plotting import plt

    points = cube_points()
    found = cube_features(points)
    eigenvalues = eigenvalues_by_area(found)
    centres = two_means(eigenvalues, found.linearity, "euclidean")
    edge = in_second(eigenvalues, centres, metric_of(eigenvalues, "euclidean"))
    colours = np.where(edge, "tab:blue", "lightgrey")
    figure = plt.figure(figsize=(20, 5))
    figure.suptitle("Santos, Galo and others: Figure 2, Figure 3 a, b and c")
    cube = figure.add_subplot(141, projection="3d")
    cube.scatter(*points.T, s=0.2, c="lightgrey")
    for number, (place, _) in PUBLISHED.items():
        cube.text(*place, str(number), color="red")
    plane = figure.add_subplot(142)
    plane.scatter(*eigenvalues[:, :2].T, s=1, c=colours)
    plane.set(xlabel="λ1 / R²", ylabel="λ2 / R²")
    figure.add_subplot(143, projection="3d").scatter(*eigenvalues.T, s=1, c=colours)
    figure.add_subplot(144, projection="3d").scatter(*points.T, s=0.5, c=colours)
    figure.savefig(folder / "santos_figures_2_and_3.png", dpi=100, bbox_inches="tight")
    plt.close(figure)
