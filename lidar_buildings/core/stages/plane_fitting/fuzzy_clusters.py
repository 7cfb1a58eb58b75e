"""Planes as clusters of normals: Voronoi neighbourhoods, potentials, fuzzy k-means, as published."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, identity
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError
from scipy.spatial.distance import cdist

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.model_selection import equations_of, plane_sums

#: Voronoi neighbours farther apart than this lie across a notch or a gap [spacings].
_LONGEST_LINK = 3.0
#: The tolerance of planes is about three times the vertical accuracy: so rough may planar surroundings be.
_ACCURACY = 1.0 / 3.0
#: The noise is the roughness that this share of the neighbourhoods does not reach; planar ones are no rougher
#: than this times the noise.
_NOISE_QUANTILE, _ROUGH = 0.35, 1.5
#: Neighbourhoods grow while half of the normals tumble by more than this [rad], and hold fewer points.
_MAX_NOISE, _MOST_NEIGHBOURS = 0.06, 60
#: Radius within which a normal adds to another's potential, as a chord; and what of it is taken off a cluster
#: found, which is a little more (Chiu 1994).
_RADIUS, _SQUASH = 0.25, 1.5
#: Weights are memberships to this power (Bezdek 1981).
_FUZZINESS = 2.0
#: Normals are clustered in bins of this width, weighted by their points: a degree is far below their noise.
_BIN = 0.02
#: Normals whose distances to all others are held at a time: rubbish has 15,000 of them.
_BLOCK = 256
#: Rounds after which centres that still move are taken as they are, and by how much less they stand still.
_MAX_ROUNDS, _STILL = 100, 1e-6


def fuzzy_planes(
    points: FloatArray, spacing: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """
    Number the points of each plane, 0 = none (Sampath & Shan 2010, sections II and III).

    The eigenvalues of each point's Voronoi neighbourhood tell planar points from others. The normals of the
    planar ones are parted by fuzzy k-means; how many clusters there are, and where they begin, follows from
    the potentials of the normals. Parallel planes of a cluster are parted by their distance, coplanar ones by
    what is connected. The other points join the nearest plane beside them. Where the paper leaves a threshold
    to the reader, it is the stage's: tolerance, accuracy and fewest points.
    """
    distinct, row_of = np.unique(points, axis=0, return_inverse=True)
    links = _voronoi_links(distinct, _LONGEST_LINK * spacing)
    normals, is_planar = _surroundings(distinct, links, _ACCURACY * config.max_plane_distance)
    if not is_planar.any():
        return np.zeros(len(points), dtype=np.int32)
    cluster = np.full(len(distinct), -1, dtype=np.int64)
    cluster[is_planar], centres = cluster_normals(normals[is_planar], min_points)
    labels = _parts(distinct, links, cluster, centres, config.max_plane_distance, min_points)
    labels = _grown(distinct, links, labels, config)
    return labels[row_of.reshape(-1)]


def cluster_normals(normals: FloatArray, min_points: int) -> tuple[IntArray, FloatArray]:
    """Part unit normals by fuzzy k-means; return each one's cluster and the clusters' mean normals."""
    _, own, count = np.unique(np.round(normals / _BIN), axis=0, return_inverse=True, return_counts=True)
    own = own.reshape(-1)
    means = np.column_stack([np.bincount(own, column) for column in normals.T]) / count[:, None]
    centres = fuzzy_k_means(means, count.astype(np.float64), starts_by_potential(means, count, min_points))
    return _squares(means, centres).argmin(axis=1)[own], centres


def starts_by_potential(normals: FloatArray, weights: NDArray[Any], min_points: int) -> FloatArray:
    """
    Return the normals that clusters begin at, the one of most potential first (Chiu 1994).

    A normal's potential is the sum of exp(−4 d²/r²) over all normals, distances d apart. That of the highest
    one, spread wider, is taken off all; as long as one is left with that of a plane's fewest points it is a
    cluster's, too, if it is far enough from those found, or high enough.
    """
    blocks = np.array_split(normals, len(normals) // _BLOCK + 1)
    potential = np.concatenate([_influence(_squares(each, normals), _RADIUS) @ weights for each in blocks])
    highest = float(potential.max())
    chosen: list[int] = []
    while (top := float(potential[best := int(potential.argmax())])) >= min_points or not chosen:
        square = _squares(normals[chosen], normals[best : best + 1]).min(initial=np.inf)
        if math.sqrt(square) / _RADIUS + top / highest < 1.0:
            potential[best] = 0.0
            continue
        chosen.append(best)
        off = _squares(normals, normals[best : best + 1])[:, 0]
        potential -= top * _influence(off, _SQUASH * _RADIUS)
    return normals[chosen]


def fuzzy_k_means(normals: FloatArray, weights: FloatArray, centres: FloatArray) -> FloatArray:
    """Return the centres of fuzzy clusters, beginning at those given, as unit normals (Bezdek 1981)."""
    for _ in range(_MAX_ROUNDS if len(centres) > 1 else 1):
        nearness = np.maximum(_squares(normals, centres), 1e-12) ** (-1.0 / (_FUZZINESS - 1.0))
        share = (nearness / nearness.sum(axis=1, keepdims=True)) ** _FUZZINESS * weights[:, None]
        before, centres = centres, share.T @ normals
        centres /= np.linalg.norm(centres, axis=1, keepdims=True)
        if np.abs(centres - before).max() < _STILL:
            break
    return centres


def _squares(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the squared chords between unit normals."""
    return np.asarray(cdist(one, other, "sqeuclidean"))


def _influence(squares: FloatArray, radius: float) -> FloatArray:
    return np.asarray(np.exp(-4.0 / radius**2 * squares))


def _voronoi_links(points: FloatArray, longest: float) -> csr_array:
    """Return which points' Voronoi cells in plan have a side in common, as a symmetric matrix of ones."""
    n = len(points)
    try:
        ends, beside = Delaunay(points[:, :2]).vertex_neighbor_vertices
    except QhullError:  # all on a line in plan
        return csr_array((n, n), dtype=np.float64)
    own = np.repeat(np.arange(n), np.diff(ends))
    near = np.hypot(*(points[own, :2] - points[beside, :2]).T) <= longest
    return coo_array((np.ones(near.sum()), (own[near], beside[near])), shape=(n, n)).tocsr()


def _surroundings(points: FloatArray, links: csr_array, accuracy: float) -> tuple[FloatArray, BoolArray]:
    """
    Return the normal of each point's Voronoi neighbourhood, upwards, and whether that is planar.

    The neighbours' neighbours are taken in as long as noise lets the normals tumble.
    """
    reach = links + csr_array(identity(len(points), format="csr"))
    near = reach
    values, normals, n = _principal_axes(points, near)
    noise = math.sqrt(np.quantile(values[:, 0] * n / np.maximum(n - 3.0, 1.0), _NOISE_QUANTILE))
    while _noise_of_normals(values, n, noise) > _MAX_NOISE and near.nnz < _MOST_NEIGHBOURS * len(points):
        near = near @ reach
        near.data[:] = 1.0
        values, normals, n = _principal_axes(points, near)
    return normals, (n > 3) & (values[:, 0] <= max(accuracy, _ROUGH * noise) ** 2)


def _noise_of_normals(values: FloatArray, n: FloatArray, noise: float) -> float:
    """Return by how much half of the normals tumble, or more [rad]."""
    return noise / math.sqrt(max(float(np.median(n * values[:, 1])), 1e-12))


def _principal_axes(points: FloatArray, near: csr_array) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rising eigenvalues of what is near each point [m²], its normal, upwards, and its number."""
    pairs = (points[:, :, None] * points[:, None, :]).reshape(-1, 9)
    n = near.sum(axis=1)
    mean = (near @ points) / n[:, None]
    spread = (near @ pairs).reshape(-1, 3, 3) / n[:, None, None] - mean[:, :, None] * mean[:, None, :]
    values, axes = np.linalg.eigh(spread)
    normals = axes[:, :, 0] * np.where(axes[:, 2, 0] < 0.0, -1.0, 1.0)[:, None]
    return np.maximum(values, 0.0), normals, n


def _parts(
    points: FloatArray,
    links: csr_array,
    cluster: IntArray,
    centres: FloatArray,
    tolerance: float,
    min_points: int,
) -> NDArray[np.int32]:
    """Number what of one cluster is connected and not a step apart, by neighbours and theirs."""
    one, other = (links + links @ links).nonzero()
    is_pair = (cluster[one] == cluster[other]) & (cluster[one] >= 0)
    one, other = one[is_pair], other[is_pair]
    step = np.einsum("ij,ij->i", points[one] - points[other], centres[cluster[one]])
    is_level = np.abs(step) <= tolerance
    graph = coo_array((np.ones(is_level.sum()), (one[is_level], other[is_level])), shape=links.shape)
    part = connected_components(graph, directed=False)[1]
    size = np.bincount(part, weights=cluster >= 0)
    number = np.cumsum(size >= min_points) * (size >= min_points)
    return np.asarray(np.where(cluster >= 0, number[part], 0), dtype=np.int32)


def _grown(
    points: FloatArray, links: csr_array, labels: NDArray[np.int32], config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """Let points of none join the nearest plane beside them that they lie on; take walls out."""
    equations = equations_of(plane_sums(points, labels, int(labels.max(initial=0)) + 1))
    is_wall = equations[:, 2] < math.cos(math.radians(config.max_slope_deg))
    labels = np.where(is_wall[labels], 0, labels).astype(np.int32)
    own, beside = links.nonzero()
    while True:
        is_rim = (labels[own] == 0) & (labels[beside] > 0)
        row, number = own[is_rim], labels[beside[is_rim]]
        plane = equations[number]
        off = np.abs(np.einsum("ij,ij->i", plane[:, :3], points[row]) + plane[:, 3])
        order = np.lexsort((number, off, row))
        order = order[off[order] <= config.max_plane_distance]
        if not len(order):
            return labels
        row, first = np.unique(row[order], return_index=True)
        labels[row] = number[order][first]
