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
        columns = np.ascontiguousarray(costs.T)
        _expand_all(columns, edges, ends, planes, border_cost, step_cost, max_step, labels)
    return labels


@njit(cache=True, nogil=True)
def _expand_all(costs, edges, ends, planes, border_cost, step_cost, max_step, labels):  # type: ignore[no-untyped-def]
    """
    Expand every label in turn until none gains.

    Only cells that may gain by a label are looked at: all others would keep their planes in any case.
    """
    n_cells, n_edges = len(labels), len(edges)
    first = np.zeros(n_cells + 1, np.int64)
    around = np.empty(2 * n_edges, np.int64)
    length = np.empty(n_edges)
    for e in range(n_edges):
        length[e] = np.hypot(ends[e, 2] - ends[e, 0], ends[e, 3] - ends[e, 1])
        first[edges[e, 0]] += 1
        first[edges[e, 1]] += 1
    for c in range(n_cells):
        first[c + 1] += first[c]
    for e in range(n_edges - 1, -1, -1):
        for side in range(2):
            first[edges[e, side]] -= 1
            around[first[edges[e, side]]] = e
    # Elevations of the planes on either side at either end, and what each edge costs now, and with the label
    # on its first side or its second.
    z = np.empty((4, n_edges))
    now, on_first, on_second = np.empty(n_edges), np.empty(n_edges), np.empty(n_edges)
    node, cells, pending = np.full(n_cells, -1), np.empty(n_cells, np.int64), np.empty(n_cells, np.int64)
    slack, keep, take = np.empty(n_cells), np.empty(n_cells), np.empty(n_cells)
    links = np.empty((n_edges, 2), np.int64)
    capacity = np.empty(n_edges)
    gained, unchanged = True, 0
    for turn in range(_MAX_ROUNDS * len(costs)):
        label = turn % len(costs)
        if gained:
            for e in range(n_edges):
                for side in range(2):
                    k = labels[edges[e, side]]
                    z[2 * side, e] = planes[k, 0] * ends[e, 0] + planes[k, 1] * ends[e, 1] + planes[k, 2]
                    z[2 * side + 1, e] = planes[k, 0] * ends[e, 2] + planes[k, 1] * ends[e, 3] + planes[k, 2]
            for e in range(n_edges):
                now[e] = length[e] * _border(
                    z[0, e] - z[2, e], z[1, e] - z[3, e], border_cost, step_cost, max_step
                )
                now[e] = 0.0 if labels[edges[e, 0]] == labels[edges[e, 1]] else now[e]
        a, b, c0 = planes[label, 0], planes[label, 1], planes[label, 2]
        for e in range(n_edges):
            one, other = a * ends[e, 0] + b * ends[e, 1] + c0, a * ends[e, 2] + b * ends[e, 3] + c0
            on_second[e] = length[e] * _border(
                one - z[0, e], other - z[1, e], border_cost, step_cost, max_step
            )
            on_first[e] = length[e] * _border(
                one - z[2, e], other - z[3, e], border_cost, step_cost, max_step
            )
        for c in range(n_cells):
            slack[c] = costs[labels[c], c] - costs[label, c]
        for e in range(n_edges):
            i, j = edges[e, 0], edges[e, 1]
            on_second[e] = 0.0 if labels[i] == label else on_second[e]
            on_first[e] = 0.0 if labels[j] == label else on_first[e]
            slack[i] += on_second[e]
            slack[j] += on_first[e]
        for c in range(n_cells):
            node[c] = 0 if labels[c] != label and slack[c] >= -_EPSILON else -1
        # A border to a cell that keeps its plane gains no more than what it costs now less what it would.
        # What then loses is dropped, and so on.
        for e in range(n_edges):
            i, j = edges[e, 0], edges[e, 1]
            if node[i] < 0 or node[j] < 0:
                missed = on_first[e] + on_second[e] - now[e]
                slack[i] -= missed
                slack[j] -= missed
        for begin in range(n_cells):
            if node[begin] < 0 or slack[begin] >= -_EPSILON:
                continue
            pending[0], n_pending = begin, 1
            node[begin] = -1
            while n_pending > 0:
                n_pending -= 1
                c = pending[n_pending]
                for k in range(first[c], first[c + 1]):
                    e = around[k]
                    other = edges[e, 0] + edges[e, 1] - c
                    if node[other] >= 0:
                        slack[other] -= on_first[e] + on_second[e] - now[e]
                        if slack[other] < -_EPSILON:
                            node[other], pending[n_pending] = -1, other
                            n_pending += 1
        n, n_links = 0, 0
        for c in range(n_cells):
            if node[c] >= 0:
                node[c], cells[n] = n, c
                keep[n], take[n] = costs[labels[c], c], costs[label, c]
                n += 1
        gained = False
        if n > 0:
            # With i and j the cells of an edge, E(keep, keep) = now, E(keep, take) = on the second, E(take,
            # keep) = on the first and E(take, take) = 0 are a cost of each cell alone and of the pair where i
            # takes and j keeps: first + second - now, not negative as borders obey the triangle inequality
            # (Kolmogorov & Zabih 2004).
            for i in range(n):
                for k in range(first[cells[i]], first[cells[i] + 1]):
                    e = around[k]
                    is_first = edges[e, 0] == cells[i]
                    theirs = on_first[e] if is_first else on_second[e]
                    j = node[edges[e, 1] if is_first else edges[e, 0]]
                    if j < 0:
                        keep[i] += now[e]
                        take[i] += theirs
                    elif is_first:
                        pair = max(on_first[e] + on_second[e] - now[e], 0.0)
                        keep[i] += now[e]
                        take[i] += theirs - pair
                        links[n_links, 0], links[n_links, 1], capacity[n_links] = i, j, pair
                        n_links += 1
                    else:
                        take[i] += theirs - now[e]
            for i in range(n):
                take[i] -= keep[i]
            keeps = source_side(take[:n], links[:n_links], np.zeros(n_links), capacity[:n_links])
            change = 0.0
            for i in range(n):
                change += 0.0 if keeps[i] else take[i]
            for k in range(n_links):
                change += capacity[k] if not keeps[links[k, 0]] and keeps[links[k, 1]] else 0.0
            gained = change < -_EPSILON
            for i in range(n):
                if gained and not keeps[i]:
                    labels[cells[i]] = label
        unchanged = 0 if gained else unchanged + 1
        if unchanged >= len(costs):
            return


@njit(cache=True, nogil=True)
def _border(first, last, border_cost, step_cost, max_step):  # type: ignore[no-untyped-def]
    """Return the cost of a metre of border with a step so high at either end [m²]."""
    first, last = abs(first), abs(last)
    first, last = first if first < max_step else max_step, last if last < max_step else max_step
    return border_cost + step_cost * 0.5 * (first + last)
