"""Method ``smooth_patches``, the default: smooth patches, completed to roofs; narrow parts dropped."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.classes import Rejection
from lidar_buildings.core.neighbours.cell_grid import CellGrid, first_from, sort_by_cell
from lidar_buildings.core.stages.roof_selection.candidates import Candidates, near_tangent_plane, surroundings
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.roof_patches import (
    LARGE_PATCH_AREA,
    MIN_PATCH_AREA,
    N_VOTERS,
    find_roof_surface,
    find_voted_surface,
    plane_votes,
)
from lidar_buildings.core.stages.roof_selection.steep_roofs import find_steep_roofs
from lidar_buildings.core.surfaces.morphology import square_distances
from lidar_buildings.core.surfaces.surface_patches import connected_columns, plan_areas

#: How far to look for roof around a part [m], and at least in neighbourhood radii, up to a face's width: what
#: is farther away is another house's.
PART_REACH = 2.0
PART_REACH_RADII = 2.0
#: Sectors of eight that have to show roof: a part at a straight roof edge sees it in five.
MIN_SECTORS = 6
#: How far a part may lie below the lowest roof around it [m].
PART_SINK = 0.5
#: How far a chimney, dormer or other part may rise above the roof around it: one storey [m].
MAX_PART_HEIGHT = 3.0
#: Wider neighbourhoods reach beyond the faces of houses and are hardly ever smooth [m].
FACE_WIDTH = 4.0
#: Parts that are flat may be so much narrower than `min_roof_width`.
FLAT_WIDTH = 0.6
#: Small buildings may be so much smaller than `min_building_area`, and narrower than `min_building_width`.
SHED_AREA, SHED_WIDTH = 0.5, 0.6
#: They are no longer than so many widths: vans are 2 to 3, lorries more. So much of their points is of smooth
#: patches, and so many of the points around each are on one plane with it: 0.73 and 0.83 of real ones are,
#: 0.7 and 0.78 of vans, hedges and bits of crowns.
SHED_LENGTH, SHED_SURFACE, SHED_VOTES = 1.75, 0.7, 0.8
#: So much of what was sent to them reached the ground below at most, as through parasols and crowns; and how
#: far from their edges nothing is seen below the eaves [m].
SHED_OPEN, SHED_EAVE = 0.12, 0.5
#: Side of the cells in which narrow parts are found: half of an area's cell, but no smaller than this [m].
MIN_PLAN_CELL = 0.25


def find_roofs(
    candidates: Candidates, config: RoofSelectionConfig
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.uint8]]:
    """
    Tell which points above ground are roof, which are walls of any building, and why others are no roof.

    Patches start roofs, which grow to their edges along tangent planes, whichever the return. Vehicles that
    touch one go before roofs take in what stands on them, last returns with roof all around and small parts:
    the wall between a lorry and its dock would join the two. What is too narrow goes, on its level and as a
    whole, and what is too small.
    """
    columns, radius = candidates.columns, candidates.radius
    surface = (find_voted_surface if 2.0 * radius > FACE_WIDTH else find_roof_surface)(candidates, config)
    roof = ~surface.is_other & near_tangent_plane(
        columns, surface.normals, surface.is_surface, radius, config.max_plane_distance
    )
    is_other, is_wall, rejection = surface.is_other, surface.is_wall, surface.rejection
    is_surface = surface.is_surface
    del surface  # memory
    rejection[roof] = Rejection.NONE
    every, plan = roof, columns.select(roof)
    roof = _levels(candidates, plan, plan.rows, config, rejection, is_bare=True)[0] >= 0
    del plan
    held = _held(columns, roof, radius)
    stands = _small_parts(candidates, roof, held, config) | (held & candidates.is_last)
    stands &= ~is_other
    rejection[stands] = Rejection.NONE
    every = every | stands
    roof = _without_narrow(candidates, roof | stands, config, rejection)
    sheds = _sheds(candidates, every, roof, is_surface, config)
    rejection[sheds] = Rejection.NONE
    roof |= sheds
    steep = find_steep_roofs(candidates, roof, config)
    rejection[steep] = Rejection.NONE
    return roof | steep, is_wall, rejection


def _held(columns: CellGrid, roof: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Tell which points stand on a roof: roof all around in plan, and at about its height."""
    around = surroundings(columns, roof, max(PART_REACH, min(PART_REACH_RADII * radius, FACE_WIDTH)), ~roof)
    low, high = around.lowest - PART_SINK, around.highest + MAX_PART_HEIGHT
    is_inside = around.n_sectors >= MIN_SECTORS
    column, z = columns.cell, columns.points[:, 2]
    return ~roof & is_inside[column] & (z >= low[column]) & (z <= high[column])


def _small_parts(
    candidates: Candidates, roof: NDArray[np.bool_], held: NDArray[np.bool_], config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    """Tell which points are of small connected parts, not roof yet, mostly with roof around."""
    rows = np.flatnonzero(~roof)
    label, n = candidates.parts(rows, candidates.radius)
    part = label[rows]
    is_held = 2 * np.bincount(part, held[rows], n) >= np.bincount(part, minlength=n)
    kept = np.zeros(len(roof), dtype=bool)
    kept[rows] = (is_held & (candidates.areas(label, n) <= config.max_part_area))[part]
    return kept


def _without_narrow(
    candidates: Candidates, roof: NDArray[np.bool_], config: RoofSelectionConfig, rejection: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """Take out of the roofs what is too narrow, in plan and on its level, and what is too small; note why."""
    label, n = _levels_or_flat(candidates, roof, config, rejection)
    # Buildings end, and so do their parts: but for large ones, which are no spots of a crown above a roof.
    building, n_buildings = candidates.buildings(label >= 0, config.min_building_area)
    rejection[(label >= 0) & (building < 0)] = Rejection.SMALL
    label = np.where(_ending(candidates, building, n_buildings), label, -1)
    is_large = np.append(candidates.areas(label, n) >= LARGE_PATCH_AREA, False)
    ends = _ending(candidates, label, n) | is_large[label]
    rejection[(building >= 0) & ~ends] = Rejection.ENDLESS
    return ends


def _levels_or_flat(
    candidates: Candidates, roof: NDArray[np.bool_], config: RoofSelectionConfig, rejection: NDArray[np.uint8]
) -> tuple[NDArray[np.int64], int]:
    """Return the levels as `_levels`, and what is narrower but flat: an annex is, no piece of a crown."""
    cell, rows = max(MIN_PLAN_CELL, 0.5 * candidates.cell), np.flatnonzero(roof)
    least = max(FLAT_WIDTH * config.min_roof_width, MIN_CELLS * cell)
    plan = sort_by_cell(candidates.points.take(rows, axis=0), cell)
    rows = rows[plan.rows]
    wide, n_wide = _levels(candidates, plan, rows, config, rejection)
    if least >= config.min_roof_width:
        return wide, n_wide
    label, n = _levels(candidates, plan, rows, replace(config, min_roof_width=least), rejection.copy())
    rows = np.flatnonzero((wide < 0) & (label >= 0))
    is_flat = _flat_parts(candidates, rows, config.max_roughness)
    rejection[rows[is_flat]] = Rejection.NONE
    label[rows[~is_flat]] = -1
    # what is wide by itself stays, also where what hangs on it makes a part that is not
    lost = (wide >= 0) & (label < 0)
    label[lost] = n + wide[lost]
    return label, n + n_wide


def _sheds(
    candidates: Candidates,
    every: NDArray[np.bool_],
    roof: NDArray[np.bool_],
    is_surface: NDArray[np.bool_],
    config: RoofSelectionConfig,
) -> NDArray[np.bool_]:
    """
    Tell which points are of small buildings that are no roof yet, among `every` that roofs have grown to.

    They are compact, unlike most vehicles and hedges, and even and opaque nearly all over, unlike bits of
    crowns.
    """
    rows = np.flatnonzero(every)
    label, n = candidates.parts(rows, candidates.radius)
    part, points = label[rows], candidates.points[rows]
    is_shed = np.bincount(part, is_surface[rows], n) >= SHED_SURFACE * np.bincount(part, minlength=n)
    is_shed &= (np.bincount(part, roof[rows], n) == 0) & (candidates.areas(label, n) < LARGE_PATCH_AREA)
    for number in np.flatnonzero(is_shed).tolist():
        own = points[part == number]
        # Points end half a spacing short of edges.
        width, length = np.sort(_box(own)[2]) + 0.5 * candidates.cell
        is_shed[number] = (
            width >= SHED_WIDTH * config.min_building_width
            and length <= SHED_LENGTH * width
            and width * length >= SHED_AREA * config.min_building_area
            and plane_votes(own, 0.5 * config.max_roughness)[0].mean() >= SHED_VOTES * N_VOTERS
        )
    if is_shed.any():
        ground = candidates.ground()
        ground = ground[np.argsort(ground[:, 0])]
        for number in np.flatnonzero(is_shed).tolist():
            is_shed[number] = _is_closed(points[part == number], ground, 0.5 * candidates.cell)
    label[~np.append(is_shed, False)[label]] = -1
    return _ending(candidates, label, n)


def _box(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the middle, the axes as rows and the sides of the smallest rectangle around points in plan."""
    corners = shapely.get_coordinates(shapely.oriented_envelope(shapely.multipoints(points[:, :2])))
    x, y = (corners[1] - corners[0] if len(corners) > 1 else np.zeros(2)).tolist()
    length = math.hypot(x, y) or 1.0
    axes = np.array([[x, y], [-y, x]]) / length
    along = corners @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    return 0.5 * (low + high) @ axes, axes, high - low


def _is_closed(points: NDArray[np.float64], ground: NDArray[np.float64], spacing: float) -> bool:
    """Tell whether no ground, given from west to east, was seen through the middle of a small building."""
    middle, axes, sides = _box(points)
    half = 0.5 * sides - SHED_EAVE
    if half.min() <= 0.0:
        return True
    begin, end = np.searchsorted(ground[:, 0], middle[0] + half.sum() * np.array([-1.0, 1.0]))
    is_inside = (np.abs((ground[begin:end, :2] - middle) @ axes.T) <= half).all(axis=1)
    return int(np.count_nonzero(is_inside)) <= SHED_OPEN * 4.0 * half.prod() / spacing**2


def _flat_parts(candidates: Candidates, rows: NDArray[np.intp], max_rms: float) -> NDArray[np.bool_]:
    """Tell which of some points are of connected parts of a patch's area that lie on one plane each."""
    label, n = candidates.parts(rows, candidates.radius)
    part, points = label[rows], candidates.points[rows]
    is_flat = candidates.areas(label, n) >= MIN_PATCH_AREA
    for number in np.flatnonzero(is_flat).tolist():
        own = points[part == number]
        away = np.linalg.svd(own - own.mean(axis=0), compute_uv=False)[-1]
        is_flat[number] = away <= max_rms * math.sqrt(len(own))
    return np.asarray(is_flat[part])


def _levels(
    candidates: Candidates,
    plan: CellGrid,
    rows: NDArray[np.intp],
    config: RoofSelectionConfig,
    rejection: NDArray[np.uint8],
    *,
    is_bare: bool = False,
) -> tuple[NDArray[np.int64], int]:
    """
    Return the level of each point, −1 where it is too narrow, or the plan of whole roofs is; note why.

    The roofs' points come cell by cell in their plan, `rows` says which of the candidates they are.
    """
    if not is_bare:
        is_wide = wide_enough(plan, config.min_roof_width)[plan.cell]
        rejection[rows[~is_wide]] = Rejection.NARROW_PART
        rows, plan = rows[is_wide], plan.select(is_wide)
    part = connected_columns(plan, max(LEVEL_STEP, candidates.radius))
    n = int(part.max(initial=-1)) + 1
    area = plan_areas(part, n, plan.first, plan.size)
    too_narrow = narrow_levels(plan, part, area, config, is_bare=is_bare)
    rejection[rows] = too_narrow
    label = np.full(len(rejection), -1)
    label[rows] = np.where(too_narrow == Rejection.NONE, part, -1)
    return label, n


def _ending(candidates: Candidates, label: NDArray[np.int64], n_labels: int) -> NDArray[np.bool_]:
    """Tell which points are of labels, −1 being none, that stand out."""
    rows = candidates.cells.rows
    ends = stands_out(candidates.cells, candidates.points[rows, 2], label[rows], n_labels)
    return np.asarray(np.append(ends, False)[label])


#: Cells across the narrowest part: a disc of fewer is too coarse to tell what is as wide.
MIN_CELLS = 5.0
#: Cells along the side of the blocks in which the plan is handled, so that far points cost no memory.
BLOCK = 512


def wide_enough(columns: CellGrid, min_width: float) -> NDArray[np.bool_]:
    """
    Tell which columns lie within a disc, of this diameter, that lies within the plan of the points.

    An opening: the plan is cut back by half the width and grown again by as much, and by half a column, which
    is no narrower than a spacing, else a roof is full of gaps. What lies farther away than the width and some
    columns does not matter. All pass a width below `MIN_CELLS` columns, which says nothing.
    """
    half = 0.5 * min_width / columns.size
    if half < 0.5 * MIN_CELLS:
        return np.ones(len(columns.numbers), dtype=bool)
    is_wide, holds = np.zeros(len(columns.numbers), dtype=bool), np.flatnonzero(np.diff(columns.first))
    line, place = np.ascontiguousarray(columns.places[holds].T)
    margin = 2 * math.ceil(half) + 4
    band = line // BLOCK
    for north in band[np.flatnonzero(np.diff(band, prepend=-1))] * BLOCK:
        begin, end = np.searchsorted(line, (north - margin, north + BLOCK + margin))
        for east in np.unique(place[begin:end] // BLOCK) * BLOCK:
            near = (place[begin:end] >= east - margin) & (place[begin:end] < east + BLOCK + margin)
            y, x = line[begin:end][near], place[begin:end][near]
            south, west = y.min() - 2, x.min() - 2
            plan = np.zeros((y.max() + 3 - south, x.max() + 3 - west), dtype=np.uint8)
            plan[y - south, x - west] = 1
            found = opened(square_distances(closed(plan), 0, math.ceil(half)), half)[y - south, x - west]
            own = (y >= north) & (y < north + BLOCK) & (x >= east) & (x < east + BLOCK)
            is_wide[holds[begin:end][near][own]] = found[own]
    return is_wide


def opened(depth: NDArray[np.int32], half: float) -> NDArray[np.bool_]:
    """Tell which cells a disc within the plan covers: its radius in cells, squared depths given."""
    core = (depth >= half**2).astype(np.uint8)
    return np.asarray(square_distances(core, 1, math.ceil(half + 1.0)) <= (half + 1.0) ** 2)


@kernel
def closed(plan):  # type: ignore[no-untyped-def]
    """Return a plan with cells filled that are empty by chance: gaps of few cells."""
    n, m = plan.shape
    grown, found = np.zeros((n, m), dtype=np.uint8), plan.copy()
    for i in range(1, n - 1):
        for j in range(1, m - 1):
            middle = plan[i, j - 1] | plan[i, j] | plan[i, j + 1]
            north = plan[i + 1, j - 1] | plan[i + 1, j] | plan[i + 1, j + 1]
            grown[i, j] = middle | north | plan[i - 1, j - 1] | plan[i - 1, j] | plan[i - 1, j + 1]
    for i in range(1, n - 1):
        for j in range(1, m - 1):
            middle = grown[i, j - 1] & grown[i, j] & grown[i, j + 1]
            north = grown[i + 1, j - 1] & grown[i + 1, j] & grown[i + 1, j + 1]
            found[i, j] |= middle & north & grown[i - 1, j - 1] & grown[i - 1, j] & grown[i - 1, j + 1]
    return found


#: Roofs that no step of half a storey connects are of different levels [m].
LEVEL_STEP = 1.2
#: Largest part that may be a vehicle or a hedge [m²]: larger ones as narrow are longer than 100 m.
MAX_NARROW_AREA = 300.0
#: Columns across the narrowest building: fewer are too coarse to tell.
MIN_BUILDING_CELLS = 2.0
#: Share of a part's rim beside other roofs, up to which it only touches them: a lorry's end, not a lean-to's
#: side; and how far from the rim they may be [m].
MAX_CONTACT = 0.2
CONTACT_REACH = 1.0


def narrow_levels(
    columns: CellGrid,
    part: NDArray[np.int64],
    area: NDArray[np.float64],
    config: RoofSelectionConfig,
    *,
    is_bare: bool = False,
) -> NDArray[np.uint8]:
    """
    Return the `Rejection` of roof points in parts too narrow by themselves and with what they stand on.

    A part is what steps of less than a level connect. Of those below `max_part_area` what is narrower than
    `min_roof_width` goes; those that stand alone or only touch other roofs go if they are nowhere as wide as
    `min_building_width`. Of bare roofs, which have not taken in yet what stands on them, only parts that
    touch others are judged, by their width as buildings: all may be wider than they seem.
    """
    found = np.zeros(len(part), dtype=np.uint8)
    size = columns.size
    # Of what is too coarse to be measured nothing is too narrow.
    max_opened = config.max_part_area if not is_bare and config.min_roof_width >= MIN_CELLS * size else 0.0
    min_width = config.min_building_width if config.min_building_width >= MIN_BUILDING_CELLS * size else 0.0
    chosen = np.flatnonzero((area < max(MAX_NARROW_AREA, max_opened))[part])
    chosen = chosen[np.argsort(part[chosen], kind="stable")]
    if len(chosen) == 0:
        return found
    begins = np.flatnonzero(np.diff(part[chosen], prepend=-1))
    half = 0.5 * config.min_roof_width / size
    reach = math.ceil(max(half, 0.5 * min_width / size + 0.5))
    places = columns.places[columns.cell[chosen]]
    lows = np.minimum.reduceat(places, begins) - (2 * reach + 4)
    shapes = np.maximum.reduceat(places, begins) - lows + (2 * reach + 5)
    tops = np.maximum.reduceat(columns.points[chosen, 2], begins)
    plan = (columns.points, columns.first, columns.numbers, columns.n_columns)
    cut = np.append(begins, len(chosen))
    for start, end, low, shape, top in zip(cut[:-1], cut[1:], lows, shapes, tops, strict=True):
        # Not the transposed view: its rows are contiguous if they hold one cell, and strided else.
        rows, (y, x) = chosen[start:end], np.ascontiguousarray((places[start:end] - low).T)
        own, (below, others) = np.zeros(shape, np.int32), np.zeros((2, *shape), np.uint8)
        _draw(*plan, y, x, low, top, own, below, others)
        if is_bare and not others.any():
            continue
        depth = square_distances(closed(below), 0, reach)
        if area[part[rows[0]]] < max_opened:
            found[rows[~opened(depth, half)[y, x]]] = Rejection.NARROW_PART
        width = 2.0 * (math.sqrt(depth[y, x].max()) - 0.5) * size
        if width < min_width and not found[rows].all():
            contact = _contact(own, others, size)
            if contact <= MAX_CONTACT and not (is_bare and contact == 0.0):
                found[rows] = Rejection.NARROW_BUILDING
    return found


def _contact(own: NDArray[np.int32], others: NDArray[np.uint8], size: float) -> float:
    """Return which share of a part's rim lies beside other roofs."""
    plan = closed((own > 0).astype(np.uint8))
    inner = plan[:-2, 1:-1] & plan[2:, 1:-1] & plan[1:-1, :-2] & plan[1:-1, 2:]
    rim = plan[1:-1, 1:-1] > inner
    reach = CONTACT_REACH / size
    return float((square_distances(others, 1, math.ceil(reach))[1:-1, 1:-1][rim] <= reach**2).mean())


@kernel
def _draw(points, first, numbers, row_length, y, x, low, top, own, below, others):  # type: ignore[no-untyped-def]
    """Count a part's points in a window of places; mark what is no higher than its top, and other roofs."""
    for i in range(len(y)):
        own[y[i], x[i]] += 1
    west, east = max(low[1], 0), min(low[1] + own.shape[1], row_length)
    for line in range(len(own)):
        start = (low[0] + line) * row_length
        k = first_from(numbers, start + west)
        while k < len(numbers) and numbers[k] < start + east:
            place = numbers[k] - start - low[1]
            if first[k + 1] > first[k]:
                below[line, place] = points[first[k], 2] <= top
                others[line, place] = first[k + 1] - first[k] > own[line, place]
            k += 1


#: How far what goes on may lie above or below the rim: less than a storey, more than a crown is rough [m].
MAX_STEP = 2.0
#: Largest share of the rim beyond which something goes on: houses under trees have 0.4, spots in forests 0.9.
MAX_SHARE = 0.5
#: What stands in one direction of a cell: the same roof, or what is none at its level, anything behind that.
OWN, LEVEL, BEHIND = 1, 2, 4


def stands_out(
    cells: CellGrid, elevation: NDArray[np.float64], building: NDArray[np.int64], n_buildings: int
) -> NDArray[np.bool_]:
    """
    Tell which buildings, or parts of them, end: along most of their rims nothing goes on at their level.

    What is one cell wide, a parapet or a façade, is an end, and so are the end of the data and another roof:
    a tower stands out of the roofs around it, a crown that hangs over a roof does not. Cells are such
    that a surface leaves few empty; elevations [m] and buildings, −1 being none, come cell by cell.
    """
    rim, met = np.zeros((2, n_buildings), dtype=np.int64)
    runs = cells.around(2.0 * cells.size)
    _count_rims(elevation, cells.first, cells.places, runs, building, rim, met)
    return np.asarray(met <= MAX_SHARE * rim)


@kernel
def _count_rims(elevation, first, places, runs, building, rim, met):  # type: ignore[no-untyped-def]
    """Count, by building, the directions of its cells that lead out of roofs, and those where it goes on."""
    top = np.full(len(places), -1, dtype=np.int64)
    for k in range(len(places)):
        for i in range(first[k], first[k + 1]):
            if building[i] >= 0 and (top[k] < 0 or elevation[i] >= elevation[top[k]]):
                top[k] = i
    seen = np.empty((3, 3), dtype=np.int64)
    for k in range(len(places)):
        if top[k] < 0:
            continue
        seen[:] = 0
        seen[1, 1] = OWN
        for row in range(runs.shape[1]):
            for c in range(runs[k, row, 0], runs[k, row, 1]):
                dy, dx = places[c, 0] - places[k, 0], places[c, 1] - places[k, 1]
                if max(abs(dy), abs(dx)) == 1:
                    if top[c] >= 0 and building[top[c]] == building[top[k]]:
                        seen[1 + dy, 1 + dx] |= OWN
                    elif _has_level(elevation, building, first[c], first[c + 1], elevation[top[k]]):
                        seen[1 + dy, 1 + dx] |= LEVEL
                elif abs(dy) % 2 == 0 and abs(dx) % 2 == 0:
                    seen[1 + dy // 2, 1 + dx // 2] |= BEHIND
        for one in seen.ravel():
            rim[building[top[k]]] += one & OWN == 0
            met[building[top[k]]] += one == LEVEL | BEHIND


@kernel
def _has_level(elevation, building, begin, end, level):  # type: ignore[no-untyped-def]
    """Tell whether points of no roof lie at a level."""
    n = 0
    for i in range(begin, end):
        n += building[i] < 0 and abs(elevation[i] - level) <= MAX_STEP
    return n > 0
