"""Minimum cuts of small graphs."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray

#: Capacities below this are used up [m³].
_EPSILON = 1e-12


@kernel
def source_side(excess: FloatArray, links: IntArray, forward: FloatArray, backward: FloatArray) -> BoolArray:
    """
    Cut a graph in two parts at the least cost.

    Maximum flow along shortest augmenting paths, level by level (Dinic 1970).

    Parameters
    ----------
    excess : ndarray of shape (n_nodes,)
        Capacity from the source to the node; to the sink where negative.
    links : ndarray of shape (n_links, 2), int64
        Pairs of nodes.
    forward, backward : ndarray of shape (n_links,)
        Capacities from the first node to the second and back. A link from i to j is paid for if i is on
        the source's side and j is not.

    Returns
    -------
    ndarray of shape (n_nodes,), bool
        Whether a node is on the source's side.
    """
    n = len(excess)
    source, sink = n, n + 1
    n_arcs = 2 * (len(links) + n)
    head = np.empty(n_arcs, np.int64)
    capacity = np.empty(n_arcs)
    first = np.zeros(n + 3, np.int64)
    tail = np.empty(n_arcs, np.int64)
    for k in range(len(links)):
        tail[2 * k], head[2 * k], capacity[2 * k] = links[k, 0], links[k, 1], forward[k]
        tail[2 * k + 1], head[2 * k + 1], capacity[2 * k + 1] = links[k, 1], links[k, 0], backward[k]
    for i in range(n):
        k = 2 * (len(links) + i)
        if excess[i] >= 0:
            tail[k], head[k], capacity[k] = source, i, excess[i]
            tail[k + 1], head[k + 1], capacity[k + 1] = i, source, 0.0
        else:
            tail[k], head[k], capacity[k] = i, sink, -excess[i]
            tail[k + 1], head[k + 1], capacity[k + 1] = sink, i, 0.0
    for k in range(n_arcs):
        first[tail[k]] += 1
    for i in range(n + 2):
        first[i + 1] += first[i]
    arcs = np.empty(n_arcs, np.int64)
    for k in range(n_arcs - 1, -1, -1):
        first[tail[k]] -= 1
        arcs[first[tail[k]]] = k
    level, at, path = np.empty(n + 2, np.int64), np.empty(n + 2, np.int64), np.empty(n + 2, np.int64)
    while _set_levels(source, sink, first, arcs, head, capacity, level, at, path):
        _saturate(source, sink, first, arcs, head, capacity, level, at, path)
    keeps = np.empty(n, np.bool_)
    for i in range(n):
        keeps[i] = level[i] >= 0
    return keeps


@inner_kernel
def _set_levels(source, sink, first, arcs, head, capacity, level, at, queue):  # type: ignore[no-untyped-def]
    """
    Write each node's distance from the source, -1 = not reached, and its first arc.

    Return whether the sink is reached.
    """
    for i in range(len(level)):
        level[i], at[i] = -1, first[i]
    level[source], queue[0] = 0, source
    start, stop = 0, 1
    while start < stop:
        node = queue[start]
        start += 1
        for k in range(first[node], first[node + 1]):
            arc = arcs[k]
            if capacity[arc] > _EPSILON and level[head[arc]] < 0:
                level[head[arc]] = level[node] + 1
                queue[stop] = head[arc]
                stop += 1
    return level[sink] >= 0


@inner_kernel
def _saturate(source, sink, first, arcs, head, capacity, level, at, path):  # type: ignore[no-untyped-def]
    """Send flow along paths of rising level until every such path is used up."""
    depth, node = 0, source
    while True:
        if node == sink:
            least = capacity[path[0]]
            for d in range(1, depth):
                least = min(least, capacity[path[d]])
            back = depth
            for d in range(depth - 1, -1, -1):
                capacity[path[d]] -= least
                capacity[path[d] ^ 1] += least
                if capacity[path[d]] <= _EPSILON:
                    back = d
            depth = back
            node = head[path[depth] ^ 1]
            continue
        moved = False
        while at[node] < first[node + 1]:
            k = arcs[at[node]]
            if capacity[k] > _EPSILON and level[head[k]] == level[node] + 1:
                path[depth] = k
                depth += 1
                node = head[k]
                moved = True
                break
            at[node] += 1
        if moved:
            continue
        if node == source:
            return
        depth -= 1
        node = head[path[depth] ^ 1]
        at[node] += 1
