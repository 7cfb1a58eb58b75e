"""Methods `consensus` and `morphological`: ground by majority, without wide roofs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.neighbours.cell_grid import raster_cells
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.union_find import numbered, sets_of_pairs
from lidar_buildings.core.stages.ground_filter.bidirectional_slope import profile_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.landforms import find_landforms
from lidar_buildings.core.stages.ground_filter.progressive_tin import grown_ground
from lidar_buildings.core.surfaces.elevation_raster import nearest_filled
from lidar_buildings.core.surfaces.opened_terrain import opened_terrain


def agreed_ground(
    candidates: NDArray[np.float64], extent: NDArray[np.float64], spacing: float, config: GroundFilterConfig
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """
    Return which candidates are landforms, or ground to two of three views, but for wide roofs; else all.

    Beside them the extents of what may be a wide roof as well, see `Plates.cut_off`. A TIN that grows
    (Axelsson 2000) fails where its seeds do, profiles (Shan and Sampath 2005) where they meet no ground on
    their way, openings (Zhang et al. 2003) where the terrain is as narrow as an object. What one of them gets
    wrong, the two others seldom do; weights that are fitted to them come out equal. Parts that one view alone
    calls ground are landforms if they meet the ground agreed on as terrain does, but for what the TIN climbs
    without wider limits, such as decks of bridges. Roofs wider than the first terrain's cells and the windows
    of the others are found by their walls. Candidates, extent and spacing are those of `grown_ground`.
    """
    votes = np.zeros((3, len(candidates)), dtype=np.int8)
    beyond = np.zeros(len(candidates), dtype=np.bool_)

    def grow() -> NDArray[np.bool_]:
        ground, beyond[:] = grown_ground(candidates, extent, spacing, config)
        return ground

    views = (
        grow,
        lambda: profile_ground(candidates, spacing, config, ()),
        lambda: opened_ground(candidates, config),
    )

    def look(begin: int, end: int) -> None:
        for k in range(begin, end):
            votes[k] = views[k]()

    for_row_blocks(look, len(views), 1)
    n_votes = votes.sum(axis=0)
    ground = n_votes >= 2
    if not ground.any():
        return np.ones_like(ground), NO_EXTENTS
    ground |= find_landforms(candidates, ground, beyond & (n_votes == 1), spacing, config)[0]
    plates = find_plates(candidates, ground, spacing)
    return ground & ~plates.on_roof, plates.cut_off


#: Points this near the terrain that the openings leave are ground; so much more per unit of its slope [m];
#: chosen with `bench.ground.isprs` and `bench.ground.scenes`.
DISTANCE, DISTANCE_SLOPE = 0.3, 1.25


def opened_ground(points: NDArray[np.float64], config: GroundFilterConfig) -> NDArray[np.bool_]:
    """
    Return which points are ground, by a progressive morphological filter (Zhang et al. 2003).

    Those within a distance of the terrain left that grows with its slope (Pingel et al. 2013). Points come in
    any order, gross errors removed.
    """
    elevation, slope = opened_terrain(points, config.opening_radius, config.opening_slope)
    return np.abs(points[:, 2] - elevation) <= DISTANCE + DISTANCE_SLOPE * slope


#: What a plate's side has to fall by [m]: a storey, more than a bank has. And by how much cells side by side
#: on one plate may differ: by the first saw-tooth roofs are one, but stairs of roofs lead down from halls.
STEP, JOINS = 3.0, (3.0, 1.5)
#: Share of a plate's sides that have to fall by a step; and what those at the edge of the data, which show
#: no step nor its absence, weigh in it.
MIN_FALLS, UNSEEN_WEIGHT = 0.8, 0.5
#: Share of a plate's sides that has to be seen before those beyond the edge of the data are worth a look.
MIN_SEEN = 0.25
#: Side of a cell: so many spacings, and at least so many metres.
CELL_SPACINGS, MIN_CELL = 2.0, 2.0
#: The extents of no plate.
NO_EXTENTS = np.empty((0, 2, 2))


class Plates(NamedTuple):
    """Wide roofs among what was taken for ground."""

    on_roof: NDArray[np.bool_]  #: points, taken for ground, that lie on roofs, shape (n_points,)
    #: Least and greatest x and y of plates that more points beyond the edge of the data might show to be
    #: roofs [m], shape (n_plates, 2, 2).
    cut_off: NDArray[np.float64]


def find_plates(points: NDArray[np.float64], ground: NDArray[np.bool_], spacing: float) -> Plates:
    """
    Tell which points, taken for ground, lie on roofs: on plates whose sides fall by a step nearly all round.

    A wall is abrupt and a hillside is not (after Chen et al. 2007), whatever its height and the width of what
    it bears. Plates are what steps up to each of `JOINS` connect. Cells without ground count to the nearest
    with, so that trees and buildings along a wall do not hide it. Beside a roof that was found lower parts of
    the same building are looked at without that side. At least one point is ground, gross errors are removed.
    """
    cell = max(CELL_SPACINGS * spacing, MIN_CELL)
    place, shape = raster_cells(points, cell)
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest.ravel(), place[ground], points[ground, 2])
    surface = nearest_filled(lowest, np.isfinite(lowest))
    judged = [_judged(surface, join) for join in JOINS]
    # A roof's rim shares cells with the ground below it.
    on_roof = np.any([is_raised[plate] for plate, is_raised, _ in judged], axis=0)
    roofs = ndimage.minimum_filter(np.where(on_roof, surface, np.inf), 3, mode="nearest").ravel()[place]
    above = points[:, 2] - surface.ravel()[place]
    is_rim = (above > STEP) & (points[:, 2] >= roofs - STEP)
    extents = [_extents(points[:, :2], plate.ravel()[place], cut_off) for plate, _, cut_off in judged]
    margin = np.array([[-cell], [cell]])
    return Plates(
        ground & (on_roof.ravel()[place] | is_rim), np.unique(np.concatenate(extents) + margin, axis=0)
    )


def _judged(
    surface: NDArray[np.float64], max_join: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the plate of each cell of a raster, which plates stand out, and which might, were they whole."""
    number = np.arange(surface.size).reshape(surface.shape)
    one = np.concatenate([number[1:].ravel(), number[:, 1:].ravel()])
    other = np.concatenate([number[:-1].ravel(), number[:, :-1].ravel()])
    rise = surface.ravel()[one] - surface.ravel()[other]
    joins = np.abs(rise) <= max_join
    plate = numbered(sets_of_pairs(surface.size, one[joins], other[joins]))
    # Every side of a plate, and what it falls by to the plate beyond.
    sides, beyond = plate[np.concatenate([one, other])], plate[np.concatenate([other, one])]
    parted = sides != beyond
    sides, beyond, is_fall = sides[parted], beyond[parted], (np.concatenate([rise, -rise]) > STEP)[parted]
    n = int(plate.max()) + 1
    edge = np.concatenate([number[0], number[-1], number[:, 0], number[:, -1]])
    unseen = np.bincount(plate[edge], minlength=n)
    raised = np.zeros(n, dtype=bool)
    while True:
        free = ~raised[beyond]
        seen = np.bincount(sides[free], minlength=n)
        falls = np.bincount(sides[free & is_fall], minlength=n)
        found = ~raised & (falls > 0) & (falls >= MIN_FALLS * (seen + UNSEEN_WEIGHT * unseen))
        if not found.any():
            cut_off = ~raised & (falls >= MIN_FALLS * seen) & (falls >= MIN_SEEN * (seen + unseen))
            return plate.reshape(surface.shape), raised, cut_off & (falls > 0)
        raised |= found


def _extents(
    xy: NDArray[np.float64], label: NDArray[np.int64], chosen: NDArray[np.bool_]
) -> NDArray[np.float64]:
    rows = np.flatnonzero(chosen[label])
    of_rows = (np.cumsum(chosen) - 1)[label[rows]]
    extents = np.full((2, int(chosen.sum()), 2), [[[np.inf]], [[-np.inf]]])
    np.minimum.at(extents[0], of_rows, xy[rows])
    np.maximum.at(extents[1], of_rows, xy[rows])
    return extents.transpose(1, 0, 2)
