"""From where points were seen, told by the place of their scanner."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.scans.trajectory import Poses

#: A scanner this far above the ground at most is on the street: higher than any mast on a vehicle, lower than
#: what flies [m].
MAX_MAST = 10.0
#: Time within which the scanner is taken to stand, for the height from which it sees [ns].
_SPAN, _MOST_SPANS = 100_000_000, 65_536
#: Share of the points of that time that are nearest to the scanner: the ground about it, below.
_NEAREST = 0.25


def view_from(
    look_up: Callable[[NDArray[np.int64]], Poses], times: NDArray[np.int64], points: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """
    Return the `View` of placed points, shape (n, 3) [m], one at least, by the scanner's poses at their times.

    What lies nearest to a scanner is the ground about it: 2 m below on the street, hundreds from the air.
    """
    span = np.minimum((times - times.min()) // _SPAN, _MOST_SPANS - 1).astype(np.uint16)
    order = np.argsort(span, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(span[order])) + 1)
    places = look_up(np.array([times[rows[0]] for rows in groups])).translation
    view = np.empty(len(points), dtype=np.uint8)
    for rows, place in zip(groups, places, strict=True):
        away = points.take(rows, axis=0) - place
        n_near = int(_NEAREST * (len(rows) - 1))
        near = np.argpartition(np.square(away).sum(axis=1), n_near)[: n_near + 1]
        view[rows] = View.STREET if -np.median(away[near, 2]) <= MAX_MAST else View.ABOVE
    return view
