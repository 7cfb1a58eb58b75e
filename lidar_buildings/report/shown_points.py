"""The points of a page: those of buildings first, thinned to a budget."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass, is_of_groups
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las import open_cloud, xyz_of
from lidar_buildings.io.results.cloud_sample import every_stretch, kept_points, stretches
from lidar_buildings.io.tiling.tile_grid import Rectangle

#: Set in `classes` for points of walls.
FACADE = 128
#: Read beside the class; numbers of buildings are whole in float64, too.
_DIMENSIONS = ("BuildingId", "PlaneId", "EdgeLabel", "intensity", "HeightAboveGround")
#: Share of the budget that the points of buildings may take.
_OF_BUILDINGS = 0.6
_STEPS = 65_535


@dataclass(frozen=True, eq=False)
class ShownPoints:
    """Points without noise, in whole steps from a corner, sorted by building."""

    steps: NDArray[np.uint16]  #: coordinates are `corner` + `steps` × `step`, shape (n_points, 3)
    #: Map frame [m], shape (3,).
    corner: NDArray[np.float64]
    step: NDArray[np.float64]
    classes: NDArray[np.uint8]  #: ASPRS class, with `FACADE` added for walls, shape (n_points,)
    #: One more than the building's row, 0 for none of those that are shown, shape (n_points,).
    building: NDArray[np.uint16]
    #: The plane within its building, 0 for none, counted on from 1 after 255, shape (n_points,).
    plane: NDArray[np.uint8]
    edge: NDArray[np.bool_]  #: whether the point lies on an edge of a roof, shape (n_points,)
    intensity: NDArray[np.uint16]  #: the source's, 0 where it has none, shape (n_points,)
    height: NDArray[np.float32]  #: above ground [m], 0 where it is not known, shape (n_points,)


def read_shown_points(
    clouds: Sequence[Path],
    frame: MapFrame,
    n_per_class: Mapping[int, int],
    rows: Mapping[int, int],
    box: Rectangle | None,
    most: int,
) -> ShownPoints:
    """
    Read the points of classified clouds, in a box or all, thinned by their number per class to the most.

    `rows` leads from a building's id to its row.
    """
    opened = [one for one in map(open_cloud, clouds) if one.point_count]
    opened = [one for one in opened if box is None or box.touches(limits_of(one, frame))]
    n_points = sum(one.point_count for one in opened)
    every = every_stretch(n_points)
    share = n_points / max(sum(n_per_class.values()), 1)
    n_roof = round(n_per_class.get(PointClass.BUILDING, 0) * share) // every
    roof_step = max(1, -(-n_roof // round(most * _OF_BUILDINGS)))
    other_step = max(1, -(-(n_points // every - n_roof) // max(most - n_roof // roof_step, 1)))
    chunks = _chunks(opened, every, is_all=box is None)
    parts = [_thinned(chunk, frame, (roof_step, other_step)) for chunk in chunks]
    xyz, labels = _joined(parts, box)
    labels[:, 1] = _rows_of(labels[:, 1], rows)
    order = np.argsort(labels[:, 1], kind="stable")[:most]
    low, high = (xyz.min(axis=0), xyz.max(axis=0)) if len(xyz) else (np.zeros(3), np.zeros(3))
    step = np.maximum((high - low) / _STEPS, 0.001)
    classes, building, plane, edge, intensity, height = labels[order].T
    return ShownPoints(
        np.rint((xyz[order] - low) / step).astype(np.uint16),
        low,
        step,
        classes.astype(np.uint8),
        building.astype(np.uint16),
        np.where(plane > 0, (plane - 1) % 255 + 1, 0).astype(np.uint8),
        edge > 0,
        intensity.astype(np.uint16),
        (height * frame.vertical_unit).astype(np.float32),
    )


def limits_of(cloud: Cloud, frame: MapFrame) -> Rectangle:
    """Return where a cloud's points lie in the map frame [m]."""
    return Rectangle(*frame.to_map(np.stack([cloud.mins, cloud.maxs]))[:, :2].ravel().tolist())


def _chunks(clouds: Sequence[Cloud], every: int, *, is_all: bool) -> Iterator[Any]:
    """Yield the clouds' points; of every so many stretches one."""
    for cloud in clouds:
        kept = kept_points(cloud) if is_all else None
        yield from stretches(cloud, every) if kept is None else [kept]


def _thinned(
    chunk: Any, frame: MapFrame, steps: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return coordinates [m] and class and `_DIMENSIONS`: of roofs and of the rest every so many-th."""
    classes = np.asarray(chunk["classification"])
    is_roof = classes == PointClass.BUILDING
    is_rest = ~is_roof & ~is_of_groups(classes, ["noise"])
    chosen = [np.flatnonzero(which)[::step] for which, step in zip((is_roof, is_rest), steps, strict=True)]
    kept = np.sort(np.concatenate(chosen))
    few = chunk[kept]
    known = set(few.point_format.dimension_names)
    labels = np.zeros((len(few), 1 + len(_DIMENSIONS)))
    labels[:, 0] = np.minimum(classes[kept], FACADE - 1)
    if "Facade" in known:
        labels[:, 0] += FACADE * (np.asarray(few["Facade"]) > 0)
    for column, name in enumerate(_DIMENSIONS, start=1):
        if name in known:
            labels[:, column] = np.nan_to_num(np.asarray(few[name]))
    return frame.to_map(xyz_of(few)), labels


def _joined(
    parts: list[tuple[NDArray[np.float64], NDArray[np.float64]]], box: Rectangle | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Put chunks together, of the points within the box."""
    xyz = np.concatenate([*(one for one, _ in parts), np.empty((0, 3))])
    labels = np.concatenate([*(one for _, one in parts), np.empty((0, 1 + len(_DIMENSIONS)))])
    if box is None:
        return xyz, labels
    within = box.holds(xyz[:, 0], xyz[:, 1])
    return xyz[within], labels[within]


def _rows_of(ids: NDArray[np.float64], rows: Mapping[int, int]) -> NDArray[np.int64]:
    """Return one more than the row of each building id, 0 where it has none."""
    if not rows:
        return np.zeros(len(ids), dtype=np.int64)
    known = np.array(sorted(rows), dtype=np.int64)
    place = np.minimum(np.searchsorted(known, ids), len(known) - 1)
    row = np.array([rows[one] for one in known.tolist()], dtype=np.int64)
    return np.where(known[place] == ids, row[place] + 1, 0)
