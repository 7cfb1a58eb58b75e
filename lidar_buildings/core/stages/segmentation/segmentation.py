"""Roof points that belong together: moving-window region growing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.ids import building_id
from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.neighbours.point_spacing import given_or_measured, group_spacings
from lidar_buildings.core.neighbours.scan_pattern import (
    ScanPattern,
    as_pulses,
    measure_scan_patterns,
    scan_cells,
)
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.core.stages.segmentation.necks import cut_necks
from lidar_buildings.core.stages.segmentation.steps import split_blocks
from lidar_buildings.core.stages.segmentation.windows import Chains, chain_along_scan, occupied_areas, turned

#: Ids are drawn from 1 to this number.
LARGEST_ID = 2**32 - 1
#: A building whose own points are sparser than expected by this factor has its own spacing: strips overlap
#: elsewhere. Less than that may be the rim, where densities are measured too low.
MIN_SPARSER = 1.25


def anchor_rows(
    points: NDArray[np.float64], component: NDArray[np.int64], n_components: int
) -> NDArray[np.int64]:
    """
    Return the row of every component's anchor: its westernmost point, ties broken by y, then z; −1 if empty.

    Points of component −1 are of none.
    """
    rows, anchor = np.flatnonzero(component >= 0), np.full(n_components, -1, dtype=np.int64)
    west = np.full(n_components, np.inf)
    np.minimum.at(west, component[rows], points[rows, 0])
    rows = rows[points[rows, 0] == west[component[rows]]]
    # The last one written stays.
    rows = rows[np.lexsort((points[rows, 2], points[rows, 1]))[::-1]]
    anchor[component[rows]] = rows
    return anchor


def distinct_ids(anchors: NDArray[np.float64]) -> NDArray[np.uint32]:
    """
    Return one id per anchor, all different.

    Where two anchors share a cell, and so an id, the western one keeps it and the other takes the next free.
    """
    wanted = [building_id(anchor) for anchor in anchors]
    order = np.lexsort((anchors[:, 2], anchors[:, 1], anchors[:, 0]))
    ids = np.zeros(len(anchors), dtype=np.uint32)
    taken = set(wanted)
    given: set[int] = set()
    for row in order:
        number = wanted[row]
        if number in given:
            while number in taken:
                number = number % LARGEST_ID + 1
            taken.add(number)
        given.add(number)
        ids[row] = number
    return ids


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Which building every point belongs to."""

    building_id: NDArray[np.uint32]  #: 0 = none, shape (n_points,)
    #: The connected block that a building is part of, before necks were cut and steps split: the id of the
    #: building with the block's westernmost point, shape (n_points,). It is the building's own where nothing
    #: was.
    block_id: NDArray[np.uint32]
    window: tuple[float, float]  #: greatest extent of the windows along x and y [m]
    patterns: dict[int, ScanPattern] = field(default_factory=dict)  #: how pulses lie on each building


def segment_buildings(
    points: ArrayLike,
    config: SegmentationConfig | None = None,
    *,
    gps_time: ArrayLike | None = None,
    point_source_id: ArrayLike | None = None,
    point_spacing: float | None = None,
) -> Segmentation:
    """
    Gather the points of each building by moving-window region growing.

    A window is centred at a point, the points in it join, the window moves on to them, and so on until
    nothing is added (Sampath & Shan, 2007); the clusters are the connected components of points that lie in
    each other's windows, and are found as such. The window is a rectangle along the scan lines where the
    points of a place show some, otherwise a square. A cluster with too few points or too small an area is
    none.

    - `points`, shape (n_points, 3): Roof points, in any order [m].
    - `gps_time`, `point_source_id`, shape (n_points,), optional: Tell scan lines; see
      `lidar_buildings.core.neighbours.scan_pattern.measure_scan_patterns`.
    - `point_spacing`, optional: Spacing of the pulses [m]; measured if not given.

    Returned: ids are made from each building's westernmost point (`lidar_buildings.core.model.ids`).
    ValueError if an argument has the wrong shape or is not finite. Linear in the number of points. Splitting
    at steps takes several times as long as all the rest.
    """
    config = config or SegmentationConfig()
    cloud = checked_points(points)
    pulses = as_pulses(cloud, gps_time, point_source_id)
    spacing = given_or_measured(cloud, point_spacing)
    cells = scan_cells(pulses, spacing)
    chains = chain_along_scan(pulses, config.window, spacing, cells, config.min_line_ratio)
    n_blocks, block_of_chain = chains.n_components, np.arange(chains.n_components)
    if config.min_neck > 0.0:
        spacings = group_spacings(cloud, cells, chains.component, n_blocks)
        chains, block_of_chain = _without_necks(cloud, chains, spacings, config, spacing)
    building = _buildings(cloud, chains, config, spacing)
    # Buildings on both ends of a neck touch there: they are of one block, as are the parts at a step.
    block = np.where(building >= 0, block_of_chain[building], -1)
    part, chain_of_part = building, np.arange(chains.n_components)
    if config.split_at_steps:
        part, chain_of_part = split_blocks(
            cloud,
            building,
            chains.n_components,
            spacing,
            min_step_height=config.min_step_height,
            min_area=config.min_area,
        )
    ids, id_of_block = _identified(cloud, block, n_blocks, part, block_of_chain[chain_of_part])
    # A building's own points, whatever lies beside it, tell the pattern that outlines are traced with.
    n_parts = len(chain_of_part)
    own = measure_scan_patterns(pulses, part, n_parts, spacing, cells=cells, min_ratio=config.min_line_ratio)
    wide = group_spacings(cloud, cells, part, n_parts)
    patterns = {
        int(ids[k]): _traced_pattern(own[k], float(wide[k]), spacing) for k in np.flatnonzero(ids[:-1])
    }
    return Segmentation(
        ids[part], id_of_block[block], _extent(chains.patterns, config.window, spacing), patterns
    )


def _without_necks(
    cloud: NDArray[np.float64],
    chains: Chains,
    spacings: NDArray[np.float64],
    config: SegmentationConfig,
    spacing: float,
) -> tuple[Chains, NDArray[np.int64]]:
    """Cut the necks of every component, in units of its own spacing; also return what each was cut from."""
    component, patterns = chains.component.copy(), list(chains.patterns)
    cut_from = list(range(chains.n_components))
    for unit, rows in _by_unit(chains, spacings, spacing):
        parts = cut_necks(
            turned(cloud.take(rows, axis=0), unit),
            chains.component[rows],
            window=config.window,
            min_neck=config.min_neck,
            min_points=config.min_points,
            min_area=config.min_area / (unit.along * unit.across),
        )
        for number, members in parts:
            component[rows[members]] = len(patterns)
            patterns.append(patterns[number])
            cut_from.append(number)
    cut = chains._replace(component=component, n_components=len(patterns), patterns=patterns)
    return cut, np.array(cut_from, dtype=np.int64)


def _by_unit(
    chains: Chains, own: NDArray[np.float64], spacing: float
) -> list[tuple[ScanPattern, NDArray[np.intp]]]:
    """Return the rows of components, of spacings `own` [m], with their units."""
    general = ScanPattern.isotropic(spacing)
    units = [
        _traced_pattern(pattern, float(one), spacing)
        for pattern, one in zip(chains.patterns, own, strict=True)
    ]
    is_general = np.array([unit == general for unit in units], dtype=bool)
    groups = [(general, np.flatnonzero(is_general[chains.component]))] if is_general.any() else []
    rows, first = rows_by_group(chains.component, chains.n_components)
    groups += [(units[k], rows[first[k] : first[k + 1]]) for k in np.flatnonzero(~is_general)]
    return groups


def _buildings(
    cloud: NDArray[np.float64], chains: Chains, config: SegmentationConfig, spacing: float
) -> NDArray[np.int64]:
    n_points = np.bincount(chains.component, minlength=chains.n_components)
    is_building = n_points >= config.min_points
    if config.min_area > 0.0:
        area = occupied_areas(cloud, chains.component, chains.n_components, spacing)
        is_building &= area >= config.min_area
    return np.where(is_building[chains.component], chains.component, -1)


def _identified(
    cloud: NDArray[np.float64],
    block: NDArray[np.int64],
    n_blocks: int,
    part: NDArray[np.int64],
    block_of_part: NDArray[np.int64],
) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Return the ids of all parts and of all blocks, 0 for those without points; the last of either is 0."""
    n_parts = len(block_of_part)
    anchor = anchor_rows(cloud, part, n_parts)
    used = np.flatnonzero(anchor >= 0)
    ids = np.zeros(n_parts + 1, dtype=np.uint32)
    ids[used] = distinct_ids(cloud[anchor[used]])
    # The westernmost point of a block is that of one of its parts.
    western = anchor_rows(cloud, block, n_blocks)
    known = block_of_part[used]
    id_of_block = np.zeros(n_blocks + 1, dtype=np.uint32)
    id_of_block[known] = ids[part[western[known]]]
    return ids, id_of_block


def _traced_pattern(own: ScanPattern, own_spacing: float, spacing: float) -> ScanPattern:
    """Return a building's own pattern; without lines, with its own spacing if its points are sparser."""
    if not own.is_isotropic:
        return own
    return ScanPattern.isotropic(own_spacing if own_spacing > MIN_SPARSER * spacing else spacing)


def _extent(patterns: list[ScanPattern], window: float, spacing: float) -> tuple[float, float]:
    wide = [ScanPattern.isotropic(spacing), *set(patterns)]
    sides = np.array([(one.along, one.across) for one in wide]) * window
    cos, sin = np.abs([(np.cos(one.direction), np.sin(one.direction)) for one in wide]).T
    x, y = sides[:, 0] * cos + sides[:, 1] * sin, sides[:, 0] * sin + sides[:, 1] * cos
    return float(x.max()), float(y.max())
