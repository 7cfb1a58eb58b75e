"""Profiles: sequences of points along which a terrain is walked, scan lines or strips cut through a cloud."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Largest number of lines: 20 bits, which leave 32 of a double's 52 for the place along a line in the sort
#: key.
MAX_STRIPS = 2.0**20


@dataclass(frozen=True, eq=False)
class Profiles:
    """Every point of a cloud on one profile, and each profile in the order of travel."""

    rows: NDArray[np.intp]  #: rows of the cloud, profile after profile, shape (n_points,)
    #: Where each profile begins in `rows`; the last one is the number of points, shape (n_profiles + 1,).
    first: NDArray[np.intp]
    along: NDArray[np.float64]  #: distance along the profile, never falling within one [m], shape (n_points,)


def cut_profiles(points: NDArray[np.float64], width: float, direction_deg: float) -> Profiles:
    """
    Cut a cloud into parallel strips along a direction, from x towards y; each is a profile.

    Strips begin at multiples of `width` from the map origin, so that a cloud's tiles are cut alike; it is
    doubled until an enormous extent can be numbered. Points come in canonical order: those at one place along
    a strip stay as they are.
    """
    angle = math.radians(direction_deg)
    along = points[:, 0] * math.cos(angle) + points[:, 1] * math.sin(angle)
    across = points[:, 1] * math.cos(angle) - points[:, 0] * math.sin(angle)
    while len(points) and float(np.ptp(across)) / width > MAX_STRIPS:
        width *= 2.0
    strip = np.floor(across / width)
    return sorted_profiles(strip - strip.min(initial=0.0), along)


def sorted_profiles(
    line: NDArray[np.float64], along: NDArray[np.float64], xy: NDArray[np.float64] | None = None
) -> Profiles:
    """
    Order points by line, at most `MAX_STRIPS`, and within a line by their place along it.

    With `xy` distances are measured from point to point instead of by `along` [m].
    """
    if len(line) == 0:
        nothing = np.zeros(0, dtype=np.intp)
        return Profiles(nothing, np.zeros(1, dtype=np.intp), np.zeros(0))
    low = along.min()
    extent = max(float(along.max() - low), 1.0)
    # One key sorts several times faster than two; a line and 2^-32 of the extent fit into a double.
    rows = np.argsort(line + (along - low) / (1.001 * extent), kind="stable")
    ordered = line[rows]
    begins = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1])))
    first = np.append(begins, len(rows)).astype(np.intp)
    place = along[rows]
    if xy is not None:
        ordered = xy[rows]
        place = np.cumsum(np.hypot(*np.diff(ordered, axis=0, prepend=ordered[:1]).T))
    return Profiles(rows, first, place)
