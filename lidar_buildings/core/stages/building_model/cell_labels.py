"""Which plane roofs which cell: fit to the points against length of the borders, by graph cuts."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.building_model.minimum_cut import source_side

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
    (`border_cost` + `step_cost` × height of the step, at most `max_step`) by one expansion move a plane
    (Boykov, Veksler & Zabih 2001); both parts are metrics, so that every move is the best of its kind.
    Further moves take three times as long for a cell in a hundred and bring models no nearer to points.

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
        args = np.ascontiguousarray(costs.T), edges, ends, planes, border_cost, step_cost, max_step, labels
        _expand_all(*args)
    return labels


@kernel
def _expand_all(costs, edges, ends, planes, border_cost, step_cost, max_step, labels):  # type: ignore[no-untyped-def]
    """
    Expand every label in turn.

    Only cells that may gain by a label are looked at: all others would keep their planes in any case. Places
    ``first[c]`` to ``first[c + 1]`` are those of the edges round cell c: which edge, and what lies beyond.
    """
    n_cells, n_edges = len(labels), len(edges)
    first, slots = np.zeros(n_cells + 1, np.int64), np.empty_like(edges)
    around, beyond = np.empty(2 * len(edges), np.int64), np.empty(2 * len(edges), np.int64)
    for e in range(len(edges)):
        first[edges[e, 0]] += 1
        first[edges[e, 1]] += 1
    for c in range(n_cells):
        first[c + 1] += first[c]
    for e in range(len(edges) - 1, -1, -1):
        for side in range(1, -1, -1):
            first[edges[e, side]] -= 1
            slots[e, side] = first[edges[e, side]]
            around[slots[e, side]], beyond[slots[e, side]] = e, edges[e, 1 - side]
    known, missed = np.empty((n_edges, 8)), np.empty(2 * n_edges)
    slack, keep, take = np.empty(n_cells), np.empty(n_cells), np.empty(n_cells)
    node, cells = np.empty(n_cells, np.int64), np.empty(n_cells, np.int64)
    pending, links = np.empty(n_cells, np.int64), np.empty((n_edges, 2), np.int64)
    capacity, nothing = np.empty(n_edges), np.zeros(n_edges)
    for e in range(n_edges):
        known[e, 7] = np.hypot(ends[e, 2] - ends[e, 0], ends[e, 3] - ends[e, 1])
    gained = True
    for label in range(len(costs)):
        a, b, c0 = planes[label, 0], planes[label, 1], planes[label, 2]
        for c in range(n_cells):
            slack[c] = costs[labels[c], c] - costs[label, c]
        for e in range(n_edges):
            i, j = edges[e, 0], edges[e, 1]
            p, q = labels[i], labels[j]
            x0, y0, x1, y1, length = ends[e, 0], ends[e, 1], ends[e, 2], ends[e, 3], known[e, 7]
            if gained:
                # Elevations on either side at either end, and what the edge costs now.
                known[e, 0] = planes[p, 0] * x0 + planes[p, 1] * y0 + planes[p, 2]
                known[e, 1] = planes[p, 0] * x1 + planes[p, 1] * y1 + planes[p, 2]
                known[e, 2] = planes[q, 0] * x0 + planes[q, 1] * y0 + planes[q, 2]
                known[e, 3] = planes[q, 0] * x1 + planes[q, 1] * y1 + planes[q, 2]
                low, high = abs(known[e, 0] - known[e, 2]), abs(known[e, 1] - known[e, 3])
                low, high = low if low < max_step else max_step, high if high < max_step else max_step
                known[e, 4] = 0.0 if p == q else length * (border_cost + step_cost * 0.5 * (low + high))
            # What it costs with the label on the first side, and on the second.
            z0, z1 = a * x0 + b * y0 + c0, a * x1 + b * y1 + c0
            low, high = abs(known[e, 2] - z0), abs(known[e, 3] - z1)
            low, high = low if low < max_step else max_step, high if high < max_step else max_step
            on_first = 0.0 if q == label else length * (border_cost + step_cost * 0.5 * (low + high))
            low, high = abs(known[e, 0] - z0), abs(known[e, 1] - z1)
            low, high = low if low < max_step else max_step, high if high < max_step else max_step
            on_second = 0.0 if p == label else length * (border_cost + step_cost * 0.5 * (low + high))
            known[e, 5], known[e, 6] = on_first, on_second
            missed[slots[e, 0]] = missed[slots[e, 1]] = on_first + on_second - known[e, 4]
            slack[i] += on_second
            slack[j] += on_first
        for c in range(n_cells):
            node[c] = 0 if labels[c] != label and slack[c] >= -_EPSILON else -1
        # A border to a cell that keeps its plane gains no more than what it costs now less what it would.
        # What then loses is dropped, and so on.
        for c in range(n_cells):
            if node[c] >= 0:
                for k in range(first[c], first[c + 1]):
                    slack[c] -= missed[k] if node[beyond[k]] < 0 else 0.0
        for begin in range(n_cells):
            if node[begin] < 0 or slack[begin] >= -_EPSILON:
                continue
            pending[0], n_pending = begin, 1
            node[begin] = -1
            while n_pending > 0:
                n_pending -= 1
                c = pending[n_pending]
                for k in range(first[c], first[c + 1]):
                    other = beyond[k]
                    if node[other] >= 0:
                        slack[other] -= missed[k]
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
                    theirs = known[e, 5] if is_first else known[e, 6]
                    j = node[beyond[k]]
                    if j < 0:
                        keep[i] += known[e, 4]
                        take[i] += theirs
                    elif is_first:
                        pair = max(missed[k], 0.0)
                        keep[i] += known[e, 4]
                        take[i] += theirs - pair
                        links[n_links, 0], links[n_links, 1], capacity[n_links] = i, j, pair
                        n_links += 1
                    else:
                        take[i] += theirs - known[e, 4]
            for i in range(n):
                take[i] -= keep[i]
            keeps = source_side(take[:n], links[:n_links], nothing[:n_links], capacity[:n_links])
            change = 0.0
            for i in range(n):
                change += 0.0 if keeps[i] else take[i]
            for k in range(n_links):
                change += capacity[k] if not keeps[links[k, 0]] and keeps[links[k, 1]] else 0.0
            gained = change < -_EPSILON
            for i in range(n):
                if gained and not keeps[i]:
                    labels[cells[i]] = label
