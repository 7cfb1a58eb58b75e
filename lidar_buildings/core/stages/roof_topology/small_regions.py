"""Small regions: a few cells of one plane amid another, as noise and rough surfaces make them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel


def absorb_small_regions(label: NDArray[np.int32], least_cells: int) -> None:
    """
    Give connected cells of a plane that are too few to the neighbour with which they share most sides.

    The largest piece of each plane stays, however small.

    Parameters
    ----------
    label : ndarray of shape (n_rows, n_columns), int32
        Numbers of planes, 0 = none; changed in place.
    least_cells : int
        Pieces with fewer cells are small.
    """
    piece, first, size = _pieces(label)
    if not len(first):
        return
    plane = label.reshape(-1)[first]
    largest = np.zeros(int(plane.max()) + 1, dtype=np.int64)
    np.maximum.at(largest, plane, size)
    small = np.flatnonzero((size < least_cells) & (size < largest[plane]))
    small = small[np.argsort(size[small], kind="stable")]
    if len(small):
        sides, stack = np.zeros(len(largest), dtype=np.int64), np.empty(int(size[small[-1]]), dtype=np.int64)
        _absorb(label.reshape(-1), label.shape[0], piece, first, small, sides, stack)


@kernel
def _pieces(label):  # type: ignore[no-untyped-def]
    """Number the connected pieces of equal labels, and return a cell and the size of each."""
    n_rows, n_columns = label.shape
    flat = label.reshape(-1)
    piece = np.full(len(flat), -1, dtype=np.int32)
    stack = np.empty(len(flat), dtype=np.int64)
    first = np.empty(len(flat), dtype=np.int64)
    size = np.empty(len(flat), dtype=np.int64)
    n = 0
    for begin in range(len(flat)):
        if flat[begin] == 0 or piece[begin] >= 0:
            continue
        piece[begin], stack[0] = n, begin
        top, count = 1, 0
        while top > 0:
            top -= 1
            cell = stack[top]
            count += 1
            r, c = cell // n_columns, cell % n_columns
            for k in range(4):
                rr, cc = _neighbour(r, c, k)
                if 0 <= rr < n_rows and 0 <= cc < n_columns:
                    other = rr * n_columns + cc
                    if piece[other] < 0 and flat[other] == flat[cell]:
                        piece[other] = n
                        stack[top] = other
                        top += 1
        first[n], size[n] = begin, count
        n += 1
    return piece, first[:n], size[:n]


@inner_kernel
def _neighbour(r, c, k):  # type: ignore[no-untyped-def]
    """Return the cell east, north, west or south of one."""
    if k == 0:
        return r, c + 1
    if k == 1:
        return r + 1, c
    if k == 2:
        return r, c - 1
    return r - 1, c


@kernel
def _absorb(flat, n_rows, piece, first, small, sides, stack):  # type: ignore[no-untyped-def]
    n_columns = len(flat) // n_rows
    for number in small:
        begin = first[number]
        stack[0], top, n = begin, 1, 0
        piece[begin] = -2
        while n < top:
            cell = stack[n]
            n += 1
            r, c = cell // n_columns, cell % n_columns
            for k in range(4):
                rr, cc = _neighbour(r, c, k)
                if 0 <= rr < n_rows and 0 <= cc < n_columns:
                    other = rr * n_columns + cc
                    if piece[other] == number:
                        piece[other] = -2
                        stack[top] = other
                        top += 1
                    elif piece[other] != -2 and flat[other] > 0:
                        sides[flat[other]] += 1
        sides[flat[begin]] = 0
        best = 0
        for k in range(len(sides)):
            best = k if sides[k] > sides[best] else best
        if sides[best] > 0:
            for k in range(top):
                flat[stack[k]] = best
        for k in range(len(sides)):
            sides[k] = 0
        for k in range(top):
            piece[stack[k]] = -1
