"""The stage: roofs, façades, vegetation and roads, one class for every point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.classes import FacadeClass, PointClass, Rejection
from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.neighbours.cell_grid import CellGrid, sort_by_cell
from lidar_buildings.core.neighbours.crowds import without_crowds
from lidar_buildings.core.neighbours.point_spacing import given_or_measured
from lidar_buildings.core.stages.roof_selection.candidates import (
    AREA_CELL,
    COLUMNS_A_RADIUS,
    MIN_RADIUS,
    RADIUS_SPACINGS,
    Candidates,
    surroundings,
)
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.facades import TOP_REACH, find_facades
from lidar_buildings.core.stages.roof_selection.published_methods import planar_cells, single_return_planes
from lidar_buildings.core.stages.roof_selection.roads import find_roads, point_brightness, road_greys
from lidar_buildings.core.stages.roof_selection.smooth_patches import find_roofs
from lidar_buildings.core.stages.roof_selection.wet_roofs import find_wet_roofs
from lidar_buildings.core.surfaces.opened_terrain import opened_terrain

#: Classes that are decided here; what has another one has it for good, but for ground that is road.
OPEN = (
    PointClass.NEVER_CLASSIFIED,
    PointClass.UNCLASSIFIED,
    PointClass.LOW_VEGETATION,
    PointClass.MEDIUM_VEGETATION,
    PointClass.HIGH_VEGETATION,
    PointClass.BUILDING,
    PointClass.MODEL_KEY_POINT,
)
#: Classes of points that are no part of the scene.
NOISE = (PointClass.LOW_NOISE, PointClass.HIGH_NOISE)
#: Method that tells no walls → its function.
METHODS = {
    "lasclassify": planar_cells,
    "single_returns": single_return_planes,
    "all": lambda candidates, config: np.ones(len(candidates.points), dtype=bool),
}
#: What is lower than this share of `min_height` may be what a bridge goes on as.
LOW_SHARE = 0.5
#: Heights up to which points count as ground where they have no classes [m].
GROUND_TOLERANCE = 0.2
#: Half of the widest object [m], the steepest terrain, rise over run, and the deepest pit [m], where heights
#: are not given; from `bench.scenes.terrain`.
OPENINGS = (30.0, 0.15, 1.0)


@dataclass(frozen=True, eq=False)
class RoofSelection:
    """The points' final classes."""

    #: `lidar_buildings.core.model.classes.PointClass`; 6 = building: roofs and façades, shape (n_points,).
    classification: NDArray[np.uint8]
    #: `lidar_buildings.core.model.classes.FacadeClass`: which of the building's points are no roof, shape
    #: (n_points,).
    facade: NDArray[np.uint8]
    #: `lidar_buildings.core.model.classes.Rejection`: why points decided here are no roof, shape (n_points,).
    rejection: NDArray[np.uint8]

    @property
    def is_facade(self) -> NDArray[np.bool_]:
        """True for the building's points that are no roof."""
        return self.facade != FacadeClass.NONE


def select_roofs(
    points: ArrayLike,
    config: RoofSelectionConfig | None = None,
    *,
    height_above_ground: ArrayLike | None = None,
    classification: ArrayLike | None = None,
    return_number: ArrayLike | None = None,
    number_of_returns: ArrayLike | None = None,
    intensity: ArrayLike | None = None,
    normalised_intensity: ArrayLike | None = None,
    point_source_id: ArrayLike | None = None,
    dark_limit: float | None = None,
    point_spacing: float | None = None,
) -> RoofSelection:
    """
    Find the points on roofs, and give every point its final class.

    By height, planarity and roughness, as Santos and others do with LAStools: among the last returns
    `min_height` above ground, neighbourhoods smoother than `max_roughness` are joined to patches wherever
    neighbouring normals agree; large patches that are no foliage start roofs. Roofs grow to their edges
    along tangent planes, whichever the return, and take in what stands on them: last returns with roof all
    around, and chimneys and dormers up to `max_part_area`. Buildings smaller than `min_building_area` are
    dropped. What hangs below roofs is façade, and so are walls as large as a building's: a scanner on the
    street does not see their roofs. The rest above ground is vegetation by height, and ground that is darker
    than other ground over an area is road (Mancera-Taboada and others, 2012).

    - `points`, shape (n_points, 3): All points, in any order, near the origin [m].
    - `config`, optional: The stage's parameters.
    - `height_above_ground`, shape (n_points,), optional: [m]; derived from the lowest points around if not
      given.
    - `classification`, shape (n_points,), optional: What is known before: 0, 1, 3 to 6 and 8 are decided
      here; ground 2 can become road 11; noise, water and all others stay. If not given, points within 0.2 m
      of the ground are ground.
    - `return_number`, `number_of_returns`, shape (n_points,), optional: Used only if both are given and a
      pulse has a single return; else every point counts as the only return of its pulse.
    - `intensity`, shape (n_points,), optional: As recorded; without any there are no roads.
    - `normalised_intensity`, shape (n_points,), optional: 0 to 255, alike in all flight strips; made of
      `intensity` strip by strip if not given.
    - `point_source_id`, shape (n_points,), optional: The flight strips; one if not given.
    - `dark_limit`, optional: Normalised intensity up to which ground is dark, for the automatic search for
      roads; if not given, it is found between the two modes of these points' ground.
    - `point_spacing`, optional: Spacing of the pulses [m]; measured if not given.

    Returned: classes 1 (what is under roofs, the undecided), 2, 3, 4, 5, 6, 11 and those kept. ValueError if
    an array has another shape, or a number is not finite. Neither the order of the points nor the number of
    threads changes the result. A roof's own points decide on it, so a tile's limits do not, but for buildings
    that they cut.
    """
    config = config or RoofSelectionConfig()
    if dark_limit is not None and not np.isfinite(dark_limit):
        raise ValueError(f"dark_limit = {dark_limit!r}: must be a normalised intensity")
    points = checked_points(points)
    height, classes = _prepared(points, height_above_ground, classification)
    is_last, is_only = last_and_only_returns(points, return_number, number_of_returns)
    is_open = np.isin(np.arange(256), OPEN)[classes]
    spacing = given_or_measured(points, point_spacing)
    is_low = (height < LOW_SHARE * config.min_height) & ~np.isin(np.arange(256), NOISE)[classes]
    rows = np.flatnonzero(is_open)
    radius = max(RADIUS_SPACINGS * spacing, MIN_RADIUS)
    columns = sort_by_cell(points.take(rows, axis=0), radius / COLUMNS_A_RADIUS)
    rows = rows[columns.rows]
    is_roof, facade = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=np.uint8)
    is_chosen, place = without_crowds(columns)
    chosen = rows
    each: slice | NDArray[np.int64] = slice(None)
    if not is_chosen.all():
        columns, chosen, each = columns.select(is_chosen), rows[is_chosen], place
    # Points are taken in when they are asked for: a second copy of all makes a tenth of a tile's memory.
    columns = columns._replace(points=np.empty((0, 3)), rows=np.empty(0, dtype=np.intp))
    del is_chosen, place
    is_raised = height[chosen].astype(float, copy=False) >= config.min_height
    raised = chosen[is_raised]
    candidates = Candidates(
        _filled(columns, points, raised, columns.first_of(is_raised)),
        is_last[raised],
        is_only[raised],
        lambda: points.take(np.flatnonzero(is_low), axis=0),
        radius,
        AREA_CELL * spacing,
    )
    del raised
    roof, wall = np.zeros((2, len(chosen)), dtype=bool)
    why = np.full(len(chosen), Rejection.LOW, dtype=np.uint8)
    if config.method == "smooth_patches":
        rows_raised = np.flatnonzero(is_raised)
        for own, part in candidates.by_spacing(spacing):
            chosen_rows = rows_raised[own]
            roof[chosen_rows], wall[chosen_rows], why[chosen_rows] = find_roofs(part, config)
    else:
        found = METHODS[config.method](candidates, config)
        roof[is_raised] = candidates.buildings(found, config.min_building_area)[0] >= 0
        why[is_raised] = np.where(found, Rejection.SMALL, Rejection.FOLIAGE)
    del candidates, is_raised
    is_roof[rows] = roof[each]
    if config.method == "smooth_patches":
        as_float = height.astype(float, copy=False)
        is_roof |= find_wet_roofs(points, as_float, is_open, is_roof, spacing, config)
        del as_float
    columns = _filled(columns, points, chosen, columns.first)
    own_height = height[chosen].astype(float, copy=False)
    of_chosen = _open_classes(columns, own_height, is_roof[chosen], wall, is_last[chosen], spacing, config)
    classes[rows], facade[rows] = (values[each] for values in of_chosen)
    rejection = np.zeros(len(points), dtype=np.uint8)
    rejection[rows] = why[each]
    rejection[classes == PointClass.BUILDING] = Rejection.NONE
    brightness = point_brightness(len(points), intensity, normalised_intensity, point_source_id, is_only)
    if brightness is not None:
        ground = np.flatnonzero(classes == PointClass.GROUND)
        of_ground = points.take(ground, axis=0), brightness[ground], is_only[ground]
        cover = points.take(np.flatnonzero(classes == PointClass.HIGH_VEGETATION), axis=0)
        find = road_greys if config.road_method == "grey_values" else find_roads
        is_road = find(*of_ground, spacing, config, cover=cover, dark_limit=dark_limit)
        classes[ground[is_road]] = PointClass.ROAD_SURFACE
    return RoofSelection(classes, facade, rejection)


def classify_beside(
    points: NDArray[np.float64],
    height: NDArray[np.float32],
    classification: NDArray[np.uint8],
    roofs: NDArray[np.float64],
    config: RoofSelectionConfig,
    point_spacing: float | None = None,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """
    Return class and `FacadeClass` of points that tell no roofs themselves, by those that others have told.

    Points (n, 3) are classified as by `select_roofs`, their `height` is above ground; `roofs` (n_roofs, 3)
    are points on roofs [m], and `point_spacing` is theirs, measured if it is not known.
    """
    classes, facade = classification.copy(), np.zeros(len(points), dtype=np.uint8)
    rows = np.flatnonzero(np.isin(np.arange(256), OPEN)[classes])
    if not len(rows):
        return classes, facade
    spacing = given_or_measured(roofs, point_spacing) if len(roofs) else point_spacing or MIN_RADIUS
    both = np.concatenate([roofs, points.take(rows, axis=0)])
    columns = sort_by_cell(both, max(RADIUS_SPACINGS * spacing, MIN_RADIUS) / COLUMNS_A_RADIUS)
    del both
    is_roof = columns.rows < len(roofs)
    heights = np.concatenate([np.full(len(roofs), config.min_height), height[rows].astype(float)])
    every = np.ones(len(is_roof), dtype=bool)
    found = _open_classes(columns, heights[columns.rows], is_roof, ~every, every, spacing, config)
    own = np.flatnonzero(~is_roof)
    chosen = rows[columns.rows[own] - len(roofs)]
    classes[chosen], facade[chosen] = (values[own] for values in found)
    return classes, facade


def _prepared(
    points: NDArray[np.float64], height_above_ground: ArrayLike | None, classification: ArrayLike | None
) -> tuple[NDArray[np.floating[Any]], NDArray[np.uint8]]:
    n = len(points)
    if height_above_ground is None:
        height = points[:, 2] - opened_terrain(points, *OPENINGS)[0]
    else:
        given = np.asarray(height_above_ground)
        height = checked_column("height_above_ground", given, n, np.result_type(given, np.float32))
        if not np.isfinite(height).all():
            row = int(np.argmin(np.isfinite(height)))
            raise ValueError(f"height_above_ground[{row}] = {height[row]}: must be finite")
    if classification is None:
        is_ground = np.abs(height) <= GROUND_TOLERANCE
        return height, np.where(is_ground, PointClass.GROUND, PointClass.UNCLASSIFIED).astype(np.uint8)
    return height, checked_column("classification", classification, n, np.uint8).copy()


def _filled(
    columns: CellGrid, points: NDArray[np.float64], rows: NDArray[np.intp], first: NDArray[np.int64]
) -> CellGrid:
    """Return columns with some of the points, which come column by column."""
    return columns._replace(points=points.take(rows, axis=0), first=first)


def _open_classes(
    columns: CellGrid,
    height: NDArray[np.float64],
    is_roof: NDArray[np.bool_],
    is_wall: NDArray[np.bool_],
    is_last: NDArray[np.bool_],
    spacing: float,
    config: RoofSelectionConfig,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the classes of the points that are decided here, and what façade they are."""
    classes = vegetation_classes(height, config)
    is_wall = is_wall & ~is_roof & (config.facade_reach > 0.0)
    stands = is_roof | is_wall
    reach = max(TOP_REACH, RADIUS_SPACINGS * spacing)
    highest = surroundings(columns, is_roof, reach, ~is_roof).highest
    above = columns.points[:, 2] - highest[columns.cell]
    classes[above <= 0.0] = PointClass.UNCLASSIFIED
    is_bare = above > TOP_REACH
    del above  # memory
    if is_wall.any():
        highest = np.maximum(highest, surroundings(columns, is_wall, reach, ~stands).highest)
    is_facade = find_facades(columns, height, stands, is_last, highest, config.facade_reach, spacing)
    classes[stands | is_facade] = PointClass.BUILDING
    facade = np.where(is_bare, FacadeClass.BARE, FacadeClass.BELOW_ROOF) * (is_facade | is_wall)
    return classes, facade.astype(np.uint8)


#: Returns of a pulse this near one another came from one surface: scanners that record a first and a last
#: return of every pulse give the same echo twice, some centimetres apart [m].
SAME_ECHO = 0.3
#: So many of the nearest points are searched for that echo.
N_NEAREST = 4


def last_and_only_returns(
    points: NDArray[np.float64], return_number: ArrayLike | None, number_of_returns: ArrayLike | None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """
    Tell which points are the last return of their pulse, and which are its only one.

    Where no pulse has a single return, the scanner recorded two of every pulse. A point then counts as the
    only return if another return number lies next to it. Every point does if either column is missing.
    """
    n = len(points)
    if return_number is None or number_of_returns is None:
        return np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    number = checked_column("return_number", return_number, n, np.int64)
    of = checked_column("number_of_returns", number_of_returns, n, np.int64)
    is_only = of <= 1
    if n and not is_only.any():
        near = cKDTree(points).query(points, N_NEAREST, distance_upper_bound=SAME_ECHO)[1]
        is_other = np.append(number, -1)[near] != number[:, None]
        is_only = (is_other & (near < n)).any(axis=1)
    return (number >= of) | is_only, is_only


#: Lowest vegetation [m] (Mancera-Taboada and others, 2012): what is lower stays unclassified.
VEGETATION_FLOOR = 0.01


def vegetation_classes(height: NDArray[np.float64], config: RoofSelectionConfig) -> NDArray[np.uint8]:
    """
    Return low, medium or high vegetation by height, unclassified below and above (Mancera-Taboada, 2012).

    Of points that are neither ground nor roof; a limit belongs to the class above it.
    """
    names = ("low_vegetation_height", "medium_vegetation_height", "max_vegetation_height")
    limits = np.maximum.accumulate([VEGETATION_FLOOR, *(getattr(config, name) for name in names)])
    classes = (1, 3, 4, 5, 1)  # PointClass: unclassified, low, medium and high vegetation
    return np.array(classes, dtype=np.uint8)[np.digitize(height, limits)]
