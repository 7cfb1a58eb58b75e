"""What clouds say of their points: class, edge, plane; one cloud alone or two of the same points."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.find_inputs import find_inputs
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.clouds.point_columns import xyz_of

#: Extra dimension of a simulated survey: the class that each point has in truth.
TRUE_CLASS = "TrueClass"
#: Dimensions that a result is read from: classes, which points of buildings are façade, and edges of roofs.
CLASS, FACADE, EDGE = "classification", "Facade", "EdgeLabel"
#: What is read beside classes where edges are looked at: façades are of class 6, too, but have no label.
EDGES = (EDGE, FACADE)
#: Folder of an output folder in which the clouds stand.
CLASSIFIED = "classified"
_SAME = "only the same points in the same order can be compared"


@dataclass(frozen=True, eq=False)
class LabelledPoints:
    """Points and what one or two sources say they are."""

    points: NDArray[np.float64]  #: in the clouds' reference system, but in metres, shape (n_points, 3)
    #: ASPRS classes, 1 for edges, or 1 for façades; one array per source and kind. Shape (n_points,).
    labels: tuple[NDArray[np.uint8], ...]
    crs: str  #: name of the reference system, empty if the clouds do not say


def has_clouds(path: Path) -> bool:
    """Whether the path is a cloud, or a folder of clouds or of results with clouds."""
    try:
        find_clouds(path)
    except InputError:
        return False
    return path.is_dir() or path.suffix.lower() in (".las", ".laz")


def find_clouds(path: Path) -> list[Path]:
    """Return the clouds of a file, a folder, or the output folder of a run; InputError if there are none."""
    return find_inputs(path / CLASSIFIED if (path / CLASSIFIED).is_dir() else path)


def read_labels(path: Path, *, prefer_truth: bool, beside: tuple[str, ...] = ()) -> LabelledPoints:
    """
    Read the points of a cloud, or a folder of them, their classes, and then the dimensions asked for.

    The true class of a simulated survey counts where a cloud has it and it is preferred. InputError if a
    cloud cannot be read, or has no edge labels.
    """
    clouds = [open_cloud(file) for file in find_clouds(path)]
    parts = [part for cloud in clouds for part in _parts(cloud, (_class_of(cloud, prefer_truth), *beside))]
    return _joined(parts, clouds, 1 + len(beside))


def read_roof_points(path: Path, classes: Collection[int]) -> tuple[NDArray[np.float64], str]:
    """
    Read the points of some classes that are no façades, and the name of their reference system.

    The true classes of a simulated survey count where a cloud has them. InputError if one cannot be read.
    """
    cloud = read_labels(path, prefer_truth=True, beside=(FACADE,))
    is_roof = np.isin(cloud.labels[0], list(classes)) & (cloud.labels[1] == 0)
    return cloud.points[is_roof], cloud.crs


def read_class_chunks(path: Path, scale: float) -> Iterator[tuple[NDArray[Any], ...]]:
    """
    Yield points [m], x and y times a factor, classes and façade marks of buildings.

    InputError if a cloud cannot be read.
    """
    for file in find_clouds(path):
        for points, *labels in _parts(open_cloud(file), (CLASS, FACADE)):
            yield points * (scale, scale, 1.0), *labels


def read_label_pairs(result: Path, reference: Path, *, beside: tuple[str, ...] = ()) -> LabelledPoints:
    """
    Read what a result and a reference say of the same points; several files are matched by name.

    Dimensions `beside` come after the result's classes, and before those of the reference: of the truth of a
    simulated survey where there is one. InputError if a cloud cannot be read or has no counterpart or no edge
    labels, or if two are not of the same points in the same order.
    """
    parts: list[tuple[NDArray[Any], ...]] = []
    clouds = []
    for mine, theirs in _matched_clouds(result, reference):
        pair = open_cloud(mine), open_cloud(theirs)
        clouds.append(pair[0])
        parts.extend(_paired_parts(*pair, (CLASS, *beside)))
    return _joined(parts, clouds, 2 + len(beside))


def _matched_clouds(result: Path, reference: Path) -> list[tuple[Path, Path]]:
    """Pair the files of both sides: one with one as they are, else by name."""
    mine, theirs = find_clouds(result), find_clouds(reference)
    if len(mine) == len(theirs) == 1:
        return [(mine[0], theirs[0])]
    by_name = [{re.sub(r"(?i)\.copc$", "", one.stem): one for one in files} for files in (mine, theirs)]
    for side, (here, there) in zip((reference, result), (by_name, by_name[::-1]), strict=True):
        lonely = sorted(here.keys() - there.keys())
        if lonely:
            raise InputError(
                f"{here[lonely[0]]}: has no counterpart named {lonely[0]}.* in {side}: "
                "give results and references of the same clouds"
            )
    return [(by_name[0][name], by_name[1][name]) for name in sorted(by_name[0])]


def _check_same_count(mine: Cloud, theirs: Cloud) -> None:
    if mine.point_count != theirs.point_count:
        raise InputError(
            f"{mine.path}: has {mine.point_count} points, but {theirs.path} has {theirs.point_count}: {_SAME}"
        )


def _check_same_points(
    pair: tuple[Cloud, Cloud], mine: NDArray[np.float64], theirs: NDArray[np.float64], first: int = 0
) -> None:
    """Refuse points [m] of two clouds, `first` on, that are others or in another order."""
    # A coordinate may have been rounded to either file's own step.
    step = np.maximum(*(np.abs(cloud.header.scales) * cloud.units for cloud in pair))
    differs = (np.abs(mine - theirs) > 1.01 * step).any(axis=1)
    if differs.any():
        raise InputError(
            f"{pair[0].path}: point {first + int(differs.argmax())} has other coordinates than in "
            f"{pair[1].path}: {_SAME}"
        )


def _class_of(cloud: Cloud, prefer_truth: bool) -> str:
    named = TRUE_CLASS in cloud.header.point_format.extra_dimension_names
    return TRUE_CLASS if prefer_truth and named else CLASS


def _parts(cloud: Cloud, dimensions: tuple[str, ...]) -> Iterator[tuple[NDArray[Any], ...]]:
    if EDGE in dimensions and EDGE not in cloud.header.point_format.extra_dimension_names:
        raise InputError(
            f"{cloud.path}: has no dimension {EDGE}: give the output of lidar-buildings run, "
            "which labels the edges of roofs"
        )
    no_facade = FACADE not in cloud.header.point_format.extra_dimension_names
    for chunk in cloud.chunks():
        labels = (
            np.asarray(np.zeros(len(chunk)) if name == FACADE and no_facade else chunk[name], dtype=np.uint8)
            for name in dimensions
        )
        yield xyz_of(chunk) * cloud.units, *labels


def _paired_parts(
    mine: Cloud, theirs: Cloud, dimensions: tuple[str, ...]
) -> Iterator[tuple[NDArray[Any], ...]]:
    _check_same_count(mine, theirs)
    row = 0
    for (points, *my_labels), (their_points, *their_labels) in zip(
        _parts(mine, dimensions), _parts(theirs, (_class_of(theirs, True),)), strict=True
    ):
        _check_same_points((mine, theirs), points, their_points, row)
        row += len(points)
        yield points, *my_labels, *their_labels


def _joined(parts: list[tuple[NDArray[Any], ...]], clouds: list[Cloud], n_labels: int) -> LabelledPoints:
    """Put chunks together; without any, there are no points and no labels of any source."""
    crs = next((cloud.crs.name for cloud in clouds if cloud.crs.name), "")
    if not parts:
        none = np.empty(0, dtype=np.uint8)
        return LabelledPoints(np.empty((0, 3)), (none,) * n_labels, crs)
    points, *labels = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return LabelledPoints(points, tuple(labels), crs)


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
    for mine, theirs in _matched_clouds(result, reference):
        pair = open_cloud(mine), open_cloud(theirs)
        _check_same_count(*pair)
        points, numbers = _read(pair[0], _dimensions(pair[0], (NUMBERS,)))
        wanted = _dimensions(pair[1], (TRUTH, NUMBERS, COLOURS))
        their_points, their_numbers = _read(pair[1], wanted)
        _check_same_points(pair, points, their_points)
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
    raise InputError(f"{cloud.path}: has no dimension {wanted}: its points cannot be assigned to planes")


def _read(cloud: Cloud, names: tuple[str, ...]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
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
