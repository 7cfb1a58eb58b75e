"""The one check that every stage makes of the points it is given."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.bounds import MAX_COORDINATE

#: Points that are compared at once where there are many times as many.
_AT_ONCE = 256


def checked_points(points: ArrayLike) -> NDArray[np.float64]:
    """
    Return points as a C-contiguous float64 array of shape (n_points, 3).

    ValueError if the shape is another one, or a coordinate is not finite or beyond `MAX_COORDINATE`.
    """
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points has shape {array.shape}: must be (n_points, 3)")
    with np.errstate(invalid="ignore"):
        # what is no number is the least and the greatest of all
        if len(array) and not (np.abs(extent_of(array)) <= MAX_COORDINATE).all():
            row = int(np.argmin((np.abs(array) <= MAX_COORDINATE).all(axis=1)))
            limit = f"finite, and within {MAX_COORDINATE:g} m of 0"
            raise ValueError(f"points[{row}] = {array[row].tolist()}: coordinates must be {limit}")
    return array


def extent_of(points: NDArray[Any]) -> NDArray[Any]:
    """
    Return the least and the greatest coordinate along each axis, shape (2, n_axes).

    A column at a time: ten times as fast as numpy along the first axis. Where points lie one after the other
    in memory, many of them are first compared at once with as many others, in a third of that time.
    """
    n_rows = len(points) // _AT_ONCE
    if n_rows < _AT_ONCE or not points.flags.c_contiguous:
        return _ends(points, points)
    rows = points[: n_rows * _AT_ONCE].reshape(n_rows, -1)
    rest = points[n_rows * _AT_ONCE :]
    ends = (end.reshape(_AT_ONCE, points.shape[1]) for end in (rows.min(axis=0), rows.max(axis=0)))
    return _ends(*(np.concatenate((end, rest)) for end in ends))


def _ends(low: NDArray[Any], high: NDArray[Any]) -> NDArray[Any]:
    return np.array([[one.min() for one in low.T], [one.max() for one in high.T]])


def checked_column(name: str, values: ArrayLike, n_points: int, dtype: Any) -> NDArray[Any]:
    """
    Return one value per point as a contiguous array of `dtype`.

    ValueError if there is not exactly one value per point, one is not a number, or whole numbers are wanted
    and one is broken or out of their range.
    """
    array = np.asarray(values)
    if array.shape != (n_points,):
        raise ValueError(f"{name} has shape {array.shape}: must be ({n_points},)")
    if array.dtype.kind == "f" and np.isnan(array).any():
        raise ValueError(f"{name}[{int(np.argmax(np.isnan(array)))}] = nan: must be a number")
    with np.errstate(invalid="ignore"):
        column = np.ascontiguousarray(array, dtype=dtype)
    is_whole = array.dtype.kind in "iuf" and column.dtype.kind in "iu"
    if is_whole and not np.can_cast(array.dtype, column.dtype) and (changed := column != array).any():
        row, limits = int(np.argmax(changed)), np.iinfo(column.dtype)
        raise ValueError(
            f"{name}[{row}] = {array[row]}: must be a whole number within {limits.min} to {limits.max}"
        )
    return column


def checked_columns(n_points: int, **columns: ArrayLike | None) -> dict[str, NDArray[Any] | None]:
    """
    Return columns by name, each with one value per point in its own dtype; None where there is none.

    ValueError as `checked_column`.
    """
    return {
        name: None if column is None else checked_column(name, column, n_points, np.asarray(column).dtype)
        for name, column in columns.items()
    }
