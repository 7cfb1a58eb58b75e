"""
Least squares with equality constraints for matrices that are mostly zero.

Written out rather than left to LAPACK, whose threads cost more than such small systems do: their number
shows in the last digits.
"""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel

#: Pivots below this share of the diagonal belong to equations that follow from others.
_DEPENDENT = 1e-6


@kernel
def constrained_minimum(normal, target, rows, values):  # type: ignore[no-untyped-def]
    """
    Minimise ½ xᵀ N x - tᵀ x under R x = r; return x and the multipliers. N and t are overwritten.

    The multipliers f follow from R N⁻¹ Rᵀ f = R N⁻¹ t - r, and x = N⁻¹ (t - Rᵀ f). Unknowns that share
    equations with few others should come first: so the factor stays as sparse as N, symmetric and positive
    definite. Rows of R that follow from those before them get no multiplier.
    """
    start, row, value = _factor(normal)
    _back_substitute(start, row, value, target)
    response = rows.copy()
    for k in range(len(rows)):
        _back_substitute(start, row, value, response[k])
    excess = np.zeros(len(rows))
    for k in range(len(rows)):
        for i in range(len(target)):
            excess[k] += rows[k, i] * target[i]
        excess[k] -= values[k]
    force = _solve_semidefinite(_products(rows, response), excess)
    for i in range(len(target)):
        moved = 0.0
        for k in range(len(rows)):
            moved += force[k] * response[k, i]
        target[i] -= moved
    return target, force


@inner_kernel
def _factor(normal):  # type: ignore[no-untyped-def]
    """
    Return the Cholesky factor L of N = L Lᵀ column by column: starts, rows and values, the diagonal first.
    """
    n = len(normal)
    start = np.zeros(n + 1, dtype=np.int64)
    row = np.empty(n * (n + 1) // 2, dtype=np.int64)
    value = np.empty(len(row))
    size = 0
    for j in range(n):
        pivot = math.sqrt(max(normal[j, j], 1e-300))
        first = size
        row[size], value[size] = j, pivot
        size += 1
        for i in range(j + 1, n):
            if normal[j, i] != 0.0:
                row[size], value[size] = i, normal[j, i] / pivot
                size += 1
        for a in range(first + 1, size):
            for b in range(a, size):
                normal[row[a], row[b]] -= value[a] * value[b]
        start[j + 1] = size
    return start, row[:size], value[:size]


@inner_kernel
def _back_substitute(start, row, value, x):  # type: ignore[no-untyped-def]
    """Replace x by (L Lᵀ)⁻¹ x."""
    n = len(x)
    for j in range(n):
        if x[j] != 0.0:
            x[j] /= value[start[j]]
            for k in range(start[j] + 1, start[j + 1]):
                x[row[k]] -= value[k] * x[j]
    for j in range(n - 1, -1, -1):
        for k in range(start[j] + 1, start[j + 1]):
            x[j] -= value[k] * x[row[k]]
        x[j] /= value[start[j]]


@inner_kernel
def _products(rows, others):  # type: ignore[no-untyped-def]
    products = np.zeros((len(rows), len(others)))
    for a in range(len(rows)):
        for k in range(rows.shape[1]):
            if rows[a, k] != 0.0:
                for b in range(len(others)):
                    products[a, b] += rows[a, k] * others[b, k]
    return products


@inner_kernel
def _solve_semidefinite(matrix, right):  # type: ignore[no-untyped-def]
    """Solve a symmetric system by Cholesky; unknowns that depend on earlier ones become 0."""
    n = len(matrix)
    lower = np.zeros((n, n))
    kept = np.ones(n, dtype=np.bool_)
    x = np.zeros(n)
    for i in range(n):
        for j in range(i):
            if kept[j]:
                total = matrix[i, j]
                for k in range(j):
                    total -= lower[i, k] * lower[j, k]
                lower[i, j] = total / lower[j, j]
        pivot = matrix[i, i]
        total = right[i]
        for k in range(i):
            pivot -= lower[i, k] ** 2
            total -= lower[i, k] * x[k]
        kept[i] = pivot > _DEPENDENT * matrix[i, i]
        if kept[i]:
            lower[i, i] = math.sqrt(pivot)
            x[i] = total / lower[i, i]
        else:
            lower[i] = 0.0
    for i in range(n - 1, -1, -1):
        if kept[i]:
            for k in range(i + 1, n):
                x[i] -= lower[k, i] * x[k]
            x[i] /= lower[i, i]
    return x
