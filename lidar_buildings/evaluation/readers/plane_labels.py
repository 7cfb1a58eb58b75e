"""What clouds say of which plane their points are: by number, by the truth of a simulation, or by colour."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.evaluation.readers.labelled_points import (
    check_same_count,
    check_same_points,
    matched_clouds,
)
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las import open_cloud, xyz_of

#: Pairs of dimensions, building and plane within it, in the order in which they are looked for.
TRUTH = ("TrueBuilding", "TruePlane")
NUMBERS = ("BuildingId", "PlaneId")
COLOURS = ("red", "green", "blue")
#: Room for a building's planes, or for a channel's values, in one number.
_PER_BUILDING = 65536


@dataclass(frozen=True, eq=False)
class PlaneLabels:
    """Points of one file and the planes that a result and a reference give them."""

    name: str  #: the result's file
    points: NDArray[np.float64]  #: in the clouds' reference system, but in metres, shape (n_points, 3)
    #: A number for each plane, 0 = none, shape (n_points,).
    result: NDArray[np.int64]
    reference: NDArray[np.int64]
    by_colour: bool  #: whether the reference's numbers are colours, −1 for black
    crs: str  #: name of the reference system, empty if the clouds do not say


def read_plane_labels(result: Path, reference: Path) -> Iterator[PlaneLabels]:
    """
    Read what both sides say of the same points, file by file; several files are matched by name.

    InputError if a cloud cannot be read, says nothing of planes or has no counterpart, or if two are not of
    the same points in the same order.
    """
    for mine, theirs in matched_clouds(result, reference):
        pair = open_cloud(mine), open_cloud(theirs)
        check_same_count(*pair)
        points, numbers = _read(pair[0], _dimensions(pair[0], (NUMBERS,)))
        wanted = _dimensions(pair[1], (TRUTH, NUMBERS, COLOURS))
        their_points, their_numbers = _read(pair[1], wanted)
        check_same_points(pair, points, their_points)
        yield PlaneLabels(
            mine.name, points, numbers, their_numbers, wanted == COLOURS, pair[0].crs.name or pair[1].crs.name
        )


def _dimensions(cloud: Cloud, choices: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    """Return the first of several sets of dimensions that a cloud has; buildings may be missing."""
    there = set(cloud.header.point_format.dimension_names)
    for names in choices:
        if names[-1] in there:
            return names if names[0] in there else names[-1:]
    wanted = " or ".join(names[-1] if names != COLOURS else "colours" for names in choices)
    raise InputError(f"{cloud.path}: has no dimension {wanted}: nothing says which points are of one plane")


def _read(cloud: Cloud, names: tuple[str, ...]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read the points [m] and one number for each plane."""
    points, numbers = [np.empty((0, 3))], [np.empty(0, dtype=np.int64)]
    for chunk in cloud.chunks():
        points.append(xyz_of(chunk) * cloud.units)
        numbers.append(_numbers(chunk, names))
    return np.concatenate(points), np.concatenate(numbers)


def _numbers(chunk: Any, names: tuple[str, ...]) -> NDArray[np.int64]:
    """Join building and plane, or the channels of a colour, in one number."""
    columns = [np.asarray(chunk[name], dtype=np.int64) for name in names]
    number = np.zeros(len(chunk), dtype=np.int64)
    for column in columns:
        number = number * _PER_BUILDING + column
    if names == COLOURS:
        return np.where(number == 0, -1, number)
    return np.where(columns[-1] == 0, 0, number)
