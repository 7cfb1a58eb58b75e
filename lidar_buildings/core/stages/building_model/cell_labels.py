"""Which plane roofs which cell: fit to the points against length of the borders, by graph cuts."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.building_model.minimum_cut import source_side

#: Rows of what is known of edges. The first four are the elevations on either side at either end; then come
#: length, costs now and with a label on the first side or the second, capacities of links, and zeros.
_LENGTH, _NOW, _CAPACITY = 4, 5, 8
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
        order = np.argsort(edges.reshape(-1), kind="stable")
        first = np.zeros(len(costs) + 1, dtype=np.int64)
        np.cumsum(np.bincount(edges.reshape(-1), minlength=len(costs)), out=first[1:])
        weights = np.zeros((10, len(edges)))
        weights[_LENGTH] = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
        _expand_all(
            np.ascontiguousarray(costs.T), edges, ends, planes, border_cost, step_cost, max_step, labels,
            first, order >> 1, weights, np.empty((3, len(costs))), np.empty((3, len(costs)), dtype=np.int64),
            np.empty_like(edges),
        )  # fmt: skip
    return labels


@kernel
def _expand_all(  # type: ignore[no-untyped-def]
    costs, edges, ends, planes, border_cost, step_cost, max_step, labels,
    first, around, weights, values, numbers, links,
):  # fmt: skip
    """
    Expand every label in turn.

    Only cells that may gain by a label are looked at: all others would keep their planes in any case. The
    edges round cell c are ``around[first[c] : first[c + 1]]``; the other arrays are for work.
    """
    n_cells, n_edges = len(labels), len(edges)
    slack, keep, take = values[0], values[1], values[2]
    node, cells, pending = numbers[0], numbers[1], numbers[2]
    capacity, nothing = weights[_CAPACITY], weights[_CAPACITY + 1]
    gained = True
    for label in range(len(costs)):
        a, b, c0 = planes[label, 0], planes[label, 1], planes[label, 2]
        for e in range(n_edges):
            x0, y0, x1, y1 = ends[e, 0], ends[e, 1], ends[e, 2], ends[e, 3]
            if gained:
                for side in range(2):
                    k = labels[edges[e, side]]
                    weights[2 * side, e] = planes[k, 0] * x0 + planes[k, 1] * y0 + planes[k, 2]
                    weights[2 * side + 1, e] = planes[k, 0] * x1 + planes[k, 1] * y1 + planes[k, 2]
            z0, z1 = a * x0 + b * y0 + c0, a * x1 + b * y1 + c0
            for way in range(0 if gained else 1, 3):
                # What an edge costs now, with the label on its first side, and on its second.
                first_z = z0 if way > 0 else weights[2, e]
                last_z = z1 if way > 0 else weights[3, e]
                side = 0 if way != 1 else 2
                low, high = abs(weights[side, e] - first_z), abs(weights[side + 1, e] - last_z)
                low, high = low if low < max_step else max_step, high if high < max_step else max_step
                weights[_NOW + way, e] = weights[_LENGTH, e] * (border_cost + step_cost * 0.5 * (low + high))
        now, on_first, on_second = weights[_NOW], weights[_NOW + 1], weights[_NOW + 2]
        for c in range(n_cells):
            slack[c] = costs[labels[c], c] - costs[label, c]
        for e in range(n_edges):
            i, j = edges[e, 0], edges[e, 1]
            if labels[i] == labels[j]:
                now[e] = 0.0
            if labels[i] == label:
                on_second[e] = 0.0
            if labels[j] == label:
                on_first[e] = 0.0
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
