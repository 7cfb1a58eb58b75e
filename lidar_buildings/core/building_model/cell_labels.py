"""
Which plane roofs which cell: fit to the points against length of the borders, by graph cuts.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.building_model.minimum_cut import source_side

#: Rounds over all labels; the energy hardly falls after the second.
_MAX_ROUNDS = 4
#: Energies that differ by less are equal [m³].
_EPSILON = 1e-9


def label_cells(
    costs: NDArray[np.float64],
    edges: NDArray[np.int64],
    ends: NDArray[np.float64],
    planes: NDArray[np.float64],
    border_cost: float,
    step_cost: float,
    max_step: float,
) -> NDArray[np.int64]:
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
    costs: NDArray[np.float64],
    edges: NDArray[np.int64],
    ends: NDArray[np.float64],
    planes: NDArray[np.float64],
    weights: NDArray[np.float64],
    labels: NDArray[np.int64],
) -> None:
    """
    Expand every label in turn until none gains.

    """
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
def _border(
    end: NDArray[np.float64],
    one: NDArray[np.float64],
    other: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> float:
    """
    Return the cost of an edge between two different planes [m³].

    """
    length = np.hypot(end[2] - end[0], end[3] - end[1])
    a, b, c = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    first = min(abs(a * end[0] + b * end[1] + c), weights[2])
    last = min(abs(a * end[2] + b * end[3] + c), weights[2])
    return float(length * (weights[0] + weights[1] * 0.5 * (first + last)))


@njit(cache=True, nogil=True)
def _expand(
    costs: NDArray[np.float64],
    edges: NDArray[np.int64],
    ends: NDArray[np.float64],
    planes: NDArray[np.float64],
    weights: NDArray[np.float64],
    labels: NDArray[np.int64],
    label: int,
) -> bool:
    """
    Give `label` to the set of cells that gains most; return whether any cell changed.

    """
    n = len(labels)
    # A cell that would lose more by its points than its borders could ever gain stays.
    gain = np.zeros(n)
    for e in range(len(edges)):
        a, b = edges[e]
        if labels[a] != label:
            gain[a] += _border(ends[e], planes[labels[a]], planes[label], weights)
        if labels[b] != label:
            gain[b] += _border(ends[e], planes[labels[b]], planes[label], weights)
    node = np.full(n, -1, np.int64)
    n_nodes = 0
    for c in range(n):
        if labels[c] != label and costs[c, label] - costs[c, labels[c]] <= gain[c]:
            node[c] = n_nodes
            n_nodes += 1
    if n_nodes == 0:
        return False
    keep = np.zeros(n_nodes)
    take = np.zeros(n_nodes)
    for c in range(n):
        if node[c] >= 0:
            keep[node[c]] += costs[c, labels[c]]
            take[node[c]] += costs[c, label]
    links = np.empty((len(edges), 2), np.int64)
    forward = np.empty(len(edges))
    backward = np.empty(len(edges))
    n_links = 0
    for e in range(len(edges)):
        a, b = edges[e]
        i, j = node[a], node[b]
        if i < 0 and j < 0:
            continue
        both = (
            0.0 if labels[a] == labels[b] else _border(ends[e], planes[labels[a]], planes[labels[b]], weights)
        )
        a_stays = 0.0 if labels[a] == label else _border(ends[e], planes[labels[a]], planes[label], weights)
        b_stays = 0.0 if labels[b] == label else _border(ends[e], planes[labels[b]], planes[label], weights)
        if j < 0:
            keep[i] += both
            take[i] += b_stays
        elif i < 0:
            keep[j] += both
            take[j] += a_stays
        else:
            # E(keep, keep) = both, E(keep, take) = a_stays, E(take, keep) = b_stays, E(take, take) = 0
            # (Kolmogorov & Zabih 2004): unary terms, and one link for what both may save together.
            keep[i] += both
            take[i] += b_stays
            take[j] += a_stays - both
            w = max(a_stays + b_stays - both, 0.0)
            take[i] -= w
            links[n_links, 0] = i
            links[n_links, 1] = j
            forward[n_links] = 0.0
            backward[n_links] = w
            n_links += 1
    keeps = source_side(take - keep, links[:n_links], forward[:n_links], backward[:n_links])
    before = 0.0
    after = 0.0
    for i in range(n_nodes):
        before += keep[i]
        after += keep[i] if keeps[i] else take[i]
    for k in range(n_links):
        i, j = links[k]
        if not keeps[i] and keeps[j]:
            after += backward[k]
    if after >= before - _EPSILON:
        return False
    for c in range(n):
        if node[c] >= 0 and not keeps[node[c]]:
            labels[c] = label
    return True
