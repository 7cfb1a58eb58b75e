"""The sides of steps, one after the other along the wall between an upper and a lower roof."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray


def step_chains(
    xy: FloatArray, upright: BoolArray, upper: IntArray, top: FloatArray, cell: float
) -> tuple[IntArray, IntArray, BoolArray]:
    """
    Order the sides of cells along the steps that they make up.

    Where more than two steps meet, the wall of the highest roof goes on.

    Parameters
    ----------
    xy : ndarray of shape (n_sides, 2)
        Middles of the sides [m].
    upright : ndarray of shape (n_sides,), bool
        Which run north-south.
    upper : ndarray of shape (n_sides,), int
        Number of the upper one of each side's planes.
    top : ndarray of shape (n_sides,)
        Elevation of that plane there [m].
    cell : float
        Length of a side [m].

    Returns
    -------
    order : ndarray of shape (n_sides,), int64
        Rows of the sides, chain by chain.
    begin : ndarray of shape (n_chains + 1,), int64
        Where each chain begins in `order`.
    is_closed : ndarray of shape (n_chains,), bool
        Which go round.
    """
    # Corners of cells are whole numbers of half-sides from one another.
    column, row = np.rint((xy - xy.min(axis=0, initial=0.0)) / (0.5 * cell)).astype(np.int64).T + 1
    width = int(column.max(initial=0)) + 2
    place, reach = row * width + column, np.where(upright, width, 1)
    ends = np.column_stack([place - reach, place + reach]).reshape(-1)
    return _walked(_linked(ends, np.argsort(ends, kind="stable"), upper, top))


@kernel
def _linked(ends, order, upper, top):  # type: ignore[no-untyped-def]
    """Return which end each end of a side goes on at, -1 for none; side k has the ends 2k and 2k + 1."""
    follows = np.full(len(ends), -1, np.int64)
    begin = 0
    for i in range(1, len(order) + 1):
        if i < len(order) and ends[order[i]] == ends[order[begin]]:
            continue
        around = order[begin:i]
        begin = i
        if len(around) == 2:
            follows[around[0]], follows[around[1]] = around[1], around[0]
        for _ in range(len(around) // 2 if len(around) > 2 else 0):
            one, other = _highest_pair(around, follows, upper, top)
            if one >= 0:
                follows[one], follows[other] = other, one
    return follows


@kernel
def _highest_pair(around, follows, upper, top):  # type: ignore[no-untyped-def]
    """Return two ends that are still free at which the wall of one roof goes on, of the highest; or -1."""
    one, other, highest = -1, -1, -np.inf
    for p in around:
        for q in around:
            is_free = p < q and follows[p] < 0 and follows[q] < 0
            if is_free and upper[p >> 1] == upper[q >> 1] and top[p >> 1] > highest:
                one, other, highest = p, q, top[p >> 1]
    return one, other


@kernel
def _walked(follows):  # type: ignore[no-untyped-def]
    """Return the sides chain by chain, where each chain begins, and whether it is closed: open ones first."""
    n = len(follows) // 2
    order, begin = np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    is_closed, is_used = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    at, n_chains = 0, 0
    for closed in range(2):
        for k in range(n):
            if is_used[k] or (closed == 0 and follows[2 * k] >= 0 and follows[2 * k + 1] >= 0):
                continue
            leave = 2 * k if follows[2 * k] >= 0 else 2 * k + 1
            while True:
                is_used[leave >> 1] = True
                order[at] = leave >> 1
                at += 1
                enter = follows[leave]
                if enter < 0 or is_used[enter >> 1]:
                    break
                leave = enter ^ 1
            is_closed[n_chains] = closed == 1
            n_chains += 1
            begin[n_chains] = at
    return order, begin[: n_chains + 1], is_closed[:n_chains]
