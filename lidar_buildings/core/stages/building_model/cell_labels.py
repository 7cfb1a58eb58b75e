"""Which plane roofs which cell: fit to the points against length of the borders, by graph cuts."""

from __future__ import annotations

import numpy as np
from numba import njit

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.building_model.minimum_cut import source_side

#: Rounds over all labels; the energy hardly falls after the second.
_MAX_ROUNDS = 4
#: Energies that differ by less are equal [m³].
_EPSILON = 1e-9


def label_cells(
    costs: FloatArray,
    edges: IntArray,
    ends: FloatArray,
    planes: FloatArray,
    border_cost: float,
    step_cost: float,
    max_step: float,
) -> IntArray:
    """
    Choose a plane for every cell.

    Minimises the sum over cells of `costs` and, over edges between cells of different planes, of length ×
    (`border_cost` + `step_cost` × height of the step, at most `max_step`) by expansion moves (Boykov,
    Veksler & Zabih 2001); both parts are metrics, so that every move is the best of its kind.

    Parameters
    ----------
    costs : ndarray of shape (n_cells, n_planes)
        Misfit of each plane over each cell [m³].
    edges : ndarray of shape (n_edges, 2)
        Cells on either side.
    ends : ndarray of shape (n_edges, 4)
        Ends of the edges in plan [m].
    planes : ndarray of shape (n_planes, 3)
        z = a·x + b·y + c.
    border_cost : float
        Cost of a metre of border [m²].
    step_cost : float
        Cost of a square metre of step [m].
    max_step : float
        Height of the step that counts at most [m].

    Returns
    -------
    ndarray of shape (n_cells,), int64
        Row of the plane of each cell.
    """
    labels = np.argmin(costs, axis=1) if len(costs) else np.zeros(0, dtype=np.int64)
    if len(edges) and costs.shape[1] > 1:
        weights = np.array([border_cost, step_cost, max_step])
        _expand_all(costs, edges, ends, planes, weights, labels)
    return labels


@njit(cache=True, nogil=True)
def _expand_all(
    costs: FloatArray,
    edges: IntArray,
    ends: FloatArray,
    planes: FloatArray,
    weights: FloatArray,
    labels: IntArray,
) -> None:
    """Expand every label in turn until none gains."""
    unchanged = 0
    for _ in range(_MAX_ROUNDS):
        for label in range(costs.shape[1]):
            if _expand(costs, edges, ends, planes, weights, labels, label):
                unchanged = 0
            else:
                unchanged += 1
            if unchanged >= costs.shape[1]:
                return


@njit(cache=True, nogil=True)
def _border(end: FloatArray, one: FloatArray, other: FloatArray, weights: FloatArray) -> float:
    """Return the cost of an edge between two different planes [m³]."""
    length = np.hypot(end[2] - end[0], end[3] - end[1])
    a, b, c = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    first = min(abs(a * end[0] + b * end[1] + c), weights[2])
    last = min(abs(a * end[2] + b * end[3] + c), weights[2])
    return float(length * (weights[0] + weights[1] * 0.5 * (first + last)))


@njit(cache=True, nogil=True)
def _expand(
    costs: FloatArray,
    edges: IntArray,
    ends: FloatArray,
    planes: FloatArray,
    weights: FloatArray,
    labels: IntArray,
    label: int,
) -> bool:
    """Give `label` to the set of cells that gains most; return whether any cell changed."""
    borders = _borders(edges, ends, planes, weights, labels, label)
    node = _number_candidates(costs, edges, borders, labels, label)
    n_nodes = node.max() + 1
    if n_nodes == 0:
        return False
    keep, take = np.zeros(n_nodes), np.zeros(n_nodes)
    for c in range(len(labels)):
        if node[c] >= 0:
            keep[node[c]] += costs[c, labels[c]]
            take[node[c]] += costs[c, label]
    links, capacity = _link_candidates(edges, borders, node, keep, take)
    keeps = source_side(take - keep, links, np.zeros(len(links)), capacity)
    change = 0.0
    for i in range(n_nodes):
        change += 0.0 if keeps[i] else take[i] - keep[i]
    for k in range(len(links)):
        change += capacity[k] if not keeps[links[k, 0]] and keeps[links[k, 1]] else 0.0
    if change >= -_EPSILON:
        return False
    for c in range(len(labels)):
        if node[c] >= 0 and not keeps[node[c]]:
            labels[c] = label
    return True


@njit(cache=True, nogil=True)
def _borders(
    edges: IntArray, ends: FloatArray, planes: FloatArray, weights: FloatArray, labels: IntArray, label: int
) -> FloatArray:
    """Return each edge's cost if both cells keep their planes, only the first does, or only the second."""
    borders = np.zeros((len(edges), 3))
    for e in range(len(edges)):
        a, b = labels[edges[e, 0]], labels[edges[e, 1]]
        if a != b:
            borders[e, 0] = _border(ends[e], planes[a], planes[b], weights)
        if a != label:
            borders[e, 1] = _border(ends[e], planes[a], planes[label], weights)
        if b != label:
            borders[e, 2] = _border(ends[e], planes[b], planes[label], weights)
    return borders


@njit(cache=True, nogil=True)
def _number_candidates(
    costs: FloatArray, edges: IntArray, borders: FloatArray, labels: IntArray, label: int
) -> IntArray:
    """
    Number the cells that might take a label; -1 for those that lose more than their borders could ever gain.
    """
    gain = np.zeros(len(labels))
    for e in range(len(edges)):
        gain[edges[e, 0]] += borders[e, 1]
        gain[edges[e, 1]] += borders[e, 2]
    node = np.full(len(labels), -1, np.int64)
    n = 0
    for c in range(len(labels)):
        if labels[c] != label and costs[c, label] - costs[c, labels[c]] <= gain[c]:
            node[c] = n
            n += 1
    return node


@njit(cache=True, nogil=True)
def _link_candidates(
    edges: IntArray, borders: FloatArray, node: IntArray, keep: FloatArray, take: FloatArray
) -> tuple[IntArray, FloatArray]:
    """
    Add the borders to what keeping and taking cost, and return what only pairs can tell.

    With i and j the cells of an edge, E(keep, keep) = both, E(keep, take) = first, E(take, keep) = second
    and E(take, take) = 0 are a cost of each cell alone and of the pair where i takes and j keeps: first +
    second − both, which is not negative as borders obey the triangle inequality (Kolmogorov & Zabih 2004).
    """
    links = np.empty((len(edges), 2), np.int64)
    capacity = np.empty(len(edges))
    n = 0
    for e in range(len(edges)):
        i, j = node[edges[e, 0]], node[edges[e, 1]]
        both, first, second = borders[e]
        if i >= 0 and j >= 0:
            pair = max(first + second - both, 0.0)
            keep[i] += both
            take[i] += second - pair
            take[j] += first - both
            links[n, 0], links[n, 1], capacity[n] = i, j, pair
            n += 1
        elif i >= 0:
            keep[i] += both
            take[i] += second
        elif j >= 0:
            keep[j] += both
            take[j] += first
    return links[:n], capacity[:n]
