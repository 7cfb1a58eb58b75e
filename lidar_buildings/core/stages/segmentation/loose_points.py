"""Loose points beside a building: too few for one of their own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel


def building_beside(
    points: NDArray[np.float64],
    component: NDArray[np.int64],
    is_building: NDArray[np.bool_],
    is_loose: NDArray[np.bool_],
    reach: float,
) -> NDArray[np.int64]:
    """
    Return the component that every component's points belong to: its own, or that of the building beside it.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    component : ndarray of int64, shape (n_points,)
        From 0.
    is_building, is_loose : ndarray of bool, shape (n_components,)
        Which are buildings, and which may be counted to one.
    reach : float
        Loose points join a building if one of them lies no farther from it in plan, and none so near to
        another [m].
    """
    joined = np.arange(len(is_building))
    loose = np.flatnonzero(is_loose[component])
    if not len(loose) or reach <= 0.0 or not is_building.any():
        return joined
    by_x = points[loose[np.argsort(points[loose, 0], kind="stable")], :2]
    first = np.searchsorted(by_x[:, 0], points[:, 0] - reach)  # compiled, it would take seconds to compile
    around = np.flatnonzero(is_building[component] & _is_beside(points, by_x, first, reach))
    if not len(around):
        return joined
    tree = cKDTree(points[around, :2], balanced_tree=False, compact_nodes=False)
    near: dict[int, set[int]] = {}
    for row, found in zip(loose, tree.query_ball_point(points[loose, :2], reach), strict=True):
        near.setdefault(int(component[row]), set()).update(component[around[found]].tolist())
    for number, buildings in near.items():
        if len(buildings) == 1:
            joined[number] = buildings.pop()
    return joined


@kernel
def _is_beside(points, others, first, reach):  # type: ignore[no-untyped-def]
    """Return which points lie within reach of one of the others in x and in y; the others by rising x."""
    is_beside = np.zeros(len(points), dtype=np.bool_)
    for i in range(len(points)):
        k = first[i]
        while k < len(others) and others[k, 0] <= points[i, 0] + reach:
            if abs(points[i, 1] - others[k, 1]) <= reach:
                is_beside[i] = True
                break
            k += 1
    return is_beside
