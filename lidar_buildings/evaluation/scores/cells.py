"""Scores by point and by cell: confusion, ground points, and buildings in cells."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.point_spacing import measure_spacing


@dataclass(frozen=True)
class Confusion:
    """What the result says against what the reference says; a figure without a base (0/0) is NaN."""

    hits: int  #: yes in both
    false_alarms: int  #: yes in the result only
    misses: int  #: yes in the reference only
    rejections: int  #: no in both

    @property
    def total(self) -> int:
        """Number of items asked about."""
        return self.hits + self.false_alarms + self.misses + self.rejections

    @property
    def recall(self) -> float:
        """Share of the reference that was found, also called completeness."""
        return ratio(self.hits, self.hits + self.misses)

    @property
    def precision(self) -> float:
        """Share of the result that is right, also called correctness."""
        return ratio(self.hits, self.hits + self.false_alarms)

    @property
    def iou(self) -> float:
        """Intersection over union, also called quality."""
        return ratio(self.hits, self.hits + self.false_alarms + self.misses)

    @property
    def f1(self) -> float:
        """Harmonic mean of recall and precision."""
        return ratio(2 * self.hits, 2 * self.hits + self.false_alarms + self.misses)

    @property
    def type_1_error(self) -> float:
        """Share of the reference that was rejected (Sithole and Vosselman, 2004)."""
        return ratio(self.misses, self.hits + self.misses)

    @property
    def type_2_error(self) -> float:
        """Share of the others that was accepted."""
        return ratio(self.false_alarms, self.false_alarms + self.rejections)

    @property
    def total_error(self) -> float:
        """Share of all on which both differ."""
        return ratio(self.misses + self.false_alarms, self.total)

    @property
    def kappa(self) -> float:
        """
        Agreement beyond what chance would give (Cohen 1960): 1 is perfect, 0 is chance.

        NaN where both say the same single answer throughout: there is nothing to agree on beyond chance.
        """
        yes = (self.hits + self.false_alarms) * (self.hits + self.misses)
        no = (self.misses + self.rejections) * (self.false_alarms + self.rejections)
        # In whole numbers: both sides of (p_o − p_e) / (1 − p_e) times total².
        return ratio((self.hits + self.rejections) * self.total - yes - no, self.total**2 - yes - no)


def confusion_of(result: ArrayLike, reference: ArrayLike) -> Confusion:
    """Count the agreement of two masks of the same items; ValueError if their shapes differ or are not 1D."""
    result_mask, reference_mask = np.asarray(result, bool), np.asarray(reference, bool)
    if result_mask.ndim != 1 or result_mask.shape != reference_mask.shape:
        given = reference_mask.shape
        raise ValueError(f"reference has shape {given}: must be one-dimensional, as long as result")
    hits = int(np.count_nonzero(result_mask & reference_mask))
    yes, wanted = int(np.count_nonzero(result_mask)), int(np.count_nonzero(reference_mask))
    return Confusion(hits, yes - hits, wanted - hits, len(result_mask) - yes - wanted + hits)


#: Name of a figure, as in `doc/scores.md` → its value; a share or mean of nothing is NaN.
Figures = dict[str, Any]


def named(prefix: str, figures: Figures) -> Figures:
    """Return figures whose names begin with a prefix."""
    return {f"{prefix}_{name}": value for name, value in figures.items()}


def ratio(part: float, whole: float) -> float:
    """Return `part` / `whole`, NaN where `whole` is 0."""
    return part / whole if whole else math.nan


def mean(values: NDArray[Any]) -> float:
    """Return the mean, NaN of nothing."""
    return float(np.mean(values)) if len(values) else math.nan


def percentile(values: NDArray[np.float64], share: float) -> float:
    """Return a percentile, NaN of nothing."""
    return float(np.percentile(values, share)) if len(values) else math.nan


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Return the root of the mean square of the finite values, NaN of none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else math.nan


#: Sorted keys: the cell's column in the upper half, its row in the lower.
CellSet = NDArray[np.int64]
#: How far an empty cell looks for its nearest point [spacings]: of cells among randomly strewn points,
#: exp(−π 1.5²) = 0.1 % have none so near. A larger gap is water or shadow and holds no building.
_REACH = 1.5
#: Columns and rows must stay below this, so that a key fits into 64 bits.
MAX_NUMBER = 2**31 - 1
#: Cell centres tested against a polygon at a time [cells].
WINDOW = 4_000_000
#: Side of a cell: half a metre is what maps and eaves agree to [m].
DEFAULT_CELL = 0.5


def cells_of_polygons(polygons: ArrayLike, cell: float) -> CellSet:
    """Return cells with their centre in or on a (repaired) polygon; ValueError for a size out of range."""
    parts = polygon_parts(polygons)
    _checked_size(cell, shapely.bounds(parts))
    found = [_cells_of_part(part, cell) for part in parts]
    return _as_set(np.concatenate([*found, np.empty(0, np.int64)]))


def cells_of_points(points: ArrayLike, is_building: ArrayLike, cell: float) -> CellSet:
    """
    Return the cells [m] that hold a building point, and the empty ones whose nearest point is one.

    An empty cell looks 1.5 measured point spacings far from its centre. So at low density a roof is a closed
    surface that ends halfway between its points and the ground's, and a cell with points of other classes
    only stays what they are. ValueError if `cell` is not positive, or so small that coordinates overflow; if
    the lengths differ.
    """
    plan, chosen = np.asarray(points, dtype=np.float64)[:, :2], np.asarray(is_building, dtype=bool)
    if chosen.shape != (len(plan),):
        raise ValueError(f"is_building has shape {chosen.shape}: must be ({len(plan)},)")
    _checked_size(cell, plan)
    own = _as_set(keys_of(plan[chosen], cell))
    if not len(own):
        return own
    distance = _REACH * measure_spacing(points)
    # Cells around with their centre in reach, and a few more: a square grows by its rows, then its columns.
    steps = np.arange(-int(distance / cell + 0.5), int(distance / cell + 0.5) + 1, dtype=np.int64)
    around = own
    for offsets in (steps, steps << 32):
        around = _as_set((around[:, None] + offsets).ravel())
    empty = np.setdiff1d(around, _as_set(keys_of(plan, cell)), assume_unique=True)
    filled = empty[_nearest_is_building(cell_centres(empty, cell), plan, chosen, distance)]
    return _as_set(np.concatenate([own, filled]))


def cells_inside(cells: CellSet, area: ArrayLike, cell: float) -> CellSet:
    """Return those of the cells whose centre lies in the area of interest, one or several polygons."""
    x, y = cell_centres(cells, cell).T
    inside = np.zeros(len(cells), dtype=bool)
    for part in polygon_parts(area):
        shapely.prepare(part)
        inside |= shapely.intersects_xy(part, x, y)
    return cells[inside]


def polygon_parts(polygons: ArrayLike) -> NDArray[Any]:
    """Return the single, valid, non-empty polygons that these geometries consist of."""
    given = np.atleast_1d(np.asarray(polygons, dtype=object))
    valid = shapely.make_valid(given[~shapely.is_missing(given)])
    parts = shapely.get_parts(shapely.get_parts(valid))
    return parts[(shapely.get_type_id(parts) == shapely.GeometryType.POLYGON) & ~shapely.is_empty(parts)]


def _cells_of_part(part: shapely.Polygon, cell: float) -> CellSet:
    """Test the centres of the cells round one polygon, a band of columns at a time."""
    shapely.prepare(part)
    first, last = np.floor(np.reshape(part.bounds, (2, 2)) / cell).astype(np.int64)
    rows = np.arange(first[1], last[1] + 1)
    band = max(1, WINDOW // len(rows))
    found = []
    for start in range(first[0], last[0] + 1, band):
        columns = np.arange(start, min(start + band, last[0] + 1))
        keys = _join(np.repeat(columns, len(rows)), np.tile(rows, len(columns)))
        found.append(keys[shapely.intersects_xy(part, *cell_centres(keys, cell).T)])
    return np.concatenate(found)


def _nearest_is_building(
    centres: NDArray[np.float64], plan: NDArray[np.float64], is_building: NDArray[np.bool_], reach: float
) -> NDArray[np.bool_]:
    """Whether the nearest point of each centre, within reach, is a building's; a tie goes to the building."""
    if not len(centres):
        return np.zeros(0, dtype=bool)
    lower, upper = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    near = ((plan >= lower) & (plan <= upper)).all(axis=1)
    distances = []
    for mask in (near & is_building, near & ~is_building):
        tree = cKDTree(plan[mask], balanced_tree=False, compact_nodes=False)
        distances.append(tree.query(centres, distance_upper_bound=reach)[0])
    to_building, to_other = distances
    return np.isfinite(to_building) & (to_building <= to_other)


def _as_set(keys: NDArray[np.int64]) -> CellSet:
    """Return the keys sorted, each once; many times faster than the hashing of `numpy.unique`."""
    ordered = np.sort(keys)
    return ordered[np.concatenate(([True], ordered[1:] != ordered[:-1]))] if len(ordered) else ordered


def keys_of(plan: NDArray[np.float64], cell: float) -> NDArray[np.int64]:
    """Return the key of each position's cell."""
    columns, rows = np.floor(plan / cell).astype(np.int64).T
    return _join(columns, rows)


def _join(columns: NDArray[np.int64], rows: NDArray[np.int64]) -> CellSet:
    """Make keys: adding a step to a key moves it by rows, adding step << 32 by columns."""
    return (columns << 32) + rows


def cell_centres(cells: CellSet, cell: float) -> NDArray[np.float64]:
    """Return the centres of cells, shape (n, 2) [m]."""
    columns = (cells + 2**31) >> 32
    return (np.column_stack((columns, cells - (columns << 32))) + 0.5) * cell


def _checked_size(cell: float, coordinates: NDArray[np.float64]) -> None:
    if not (np.isfinite(cell) and cell > 0):
        raise ValueError(f"cell = {cell}: must be a positive length [m]")
    largest = float(np.abs(coordinates).max()) if coordinates.size else 0.0
    # Surroundings stay in range too.
    if not largest / cell < MAX_NUMBER / 2:
        raise ValueError(f"cell = {cell}: too small for coordinates up to {largest:g} m, or not finite")


def score_buildings(
    result: CellSet, reference: CellSet, *, cell: float = DEFAULT_CELL, area: ArrayLike | None = None
) -> Confusion:
    """Compare building cells (Rutzinger et al. 2009, pixel-based), those inside an area if given."""
    if area is not None:
        result, reference = cells_inside(result, area, cell), cells_inside(reference, area, cell)
    n_common = len(np.intersect1d(result, reference, assume_unique=True))
    return Confusion(n_common, len(result) - n_common, len(reference) - n_common, 0)


#: A result's ground: roads and rails lie on it, and water kept from the source is part of its surface.
_ON_GROUND = (PointClass.GROUND, PointClass.WATER, PointClass.RAIL, PointClass.ROAD_SURFACE)
RESULT_GROUND = tuple(map(int, _ON_GROUND))
#: A reference's ground, unless it keeps water or roads in classes of their own.
REFERENCE_GROUND = (int(PointClass.GROUND),)


def score_ground(
    result: ArrayLike, reference: ArrayLike, *, reference_ground: Collection[int] = REFERENCE_GROUND
) -> Confusion:
    """Compare ground (2, 9, 11 with water and roads) with all else, by points."""
    return confusion_of(np.isin(result, RESULT_GROUND), np.isin(reference, list(reference_ground)))
