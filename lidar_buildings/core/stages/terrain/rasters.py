"""Rasters of ground and surface of one tile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.neighbours.point_spacing import given_or_measured
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.stages.terrain.cells import (
    ADJACENT,
    GROUND,
    LEFT_OUT,
    SEEN,
    CellContents,
    CellPoints,
    Cells,
    closed,
    regions_touching,
    squared_distance,
)
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.interpolation import KRIGING
from lidar_buildings.core.stages.terrain.kriging import fit_variogram
from lidar_buildings.core.stages.terrain.window import RasterWindow, reach_in_cells, window_of

#: Classes whose points carry the terrain, and those that no surface has.
GROUND_CLASSES = (PointClass.GROUND, PointClass.WATER, PointClass.RAIL, PointClass.ROAD_SURFACE)
NOISE_CLASSES = (PointClass.LOW_NOISE, PointClass.HIGH_NOISE)
#: Side of the squares by which areas are told apart, beside three times the reach [m].
_LEAST_SQUARE = 10.0
#: What points of each class are.
_KINDS = np.full(256, SEEN, dtype=np.uint8)
_KINDS[[*GROUND_CLASSES]], _KINDS[[*NOISE_CLASSES]] = GROUND, LEFT_OUT
#: Cells that are not cut off beyond twice the reach;
#: wide margin: distances count from cells' middles.
_MARGIN_CELLS = 4.0
_EVERYWHERE = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
#: Windows of fewer cells may be as empty as they are: some 1 GB.
_SMALL = 25_000_000
#: A window of which less than one in so many squares holds a point is nearly empty.
_SPARSITY = 16


@dataclass(frozen=True, eq=False)
class TerrainRasters:
    """Ground and surface of one tile, cell by cell; the first row is the northernmost."""

    window: RasterWindow  #: where the cells lie
    #: Elevation of the bare ground and of what stands on it at the cells' middles [m]; NaN where unknown, and
    #: where another tile answers for the cell, shape (height, width).
    dtm: NDArray[np.float32]
    dsm: NDArray[np.float32]
    #: Squared distance to the tile's nearest core cell, in cells: of several tiles that answer for a cell the
    #: nearest is right, shape (height, width).
    distance: NDArray[np.int32]
    #: Variance of `dtm` where it is kriged [m²], shape (height, width): that of kriging where no ground was
    #: seen, and where it was the semivariance of cells next to one another, which is no less than its own.
    dtm_variance: NDArray[np.float32] | None = None

    @property
    def ndsm(self) -> NDArray[np.float32]:
        """Height of the surface above the ground [m]; NaN where one of them is unknown."""
        return self.dsm - self.dtm


def make_rasters(
    points: ArrayLike,
    classification: ArrayLike,
    config: RasterConfig | None = None,
    *,
    return_number: ArrayLike | None = None,
    is_core: ArrayLike | None = None,
    point_spacing: float | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
) -> TerrainRasters:
    """
    Make elevation rasters of the ground (DTM) and of the surface (DSM) from classified points.

    The DTM is the mean of each cell's ground points, moved to the cell's middle along the slope; the TIN of
    those round them closes what buildings and shadows leave open. The DSM is the highest first return of a
    cell; gaps are closed by the TIN of the highest points round them, wider holes by the ground. Noise counts
    for neither. A cell that an empty circle of radius `raster_reach` covers is unknown, so that nothing is
    made up beyond the survey's edge or across wide waters. Points that lie kilometres from all others are
    left out where they would make a window of gigabytes. A tile answers for the cells whose nearest point is
    a core point of it: rasters of neighbouring tiles fit together without gaps, and agree where their buffers
    hold what matters (twice the reach). O(n log n) in points and cells.

    - `points`, shape (n_points, 3): Map frame, in any order [m].
    - `classification`, shape (n_points,): ASPRS classes: 2, 9, 10, 11 carry the terrain, 7 and 18 are left
      out.
    - `config`, optional: Resolution, which must not be 0, and reach.
    - `return_number`, shape (n_points,), optional: Only first returns (0, 1) make the surface; all points
      where it is not given.
    - `is_core`, shape (n_points,), optional: False for points of neighbouring tiles; all True if not given.
    - `point_spacing`, optional: Mean distance of neighbouring points, by which gaps are told from waters;
      measured if not given [m].
    - `origin`: What to add to map coordinates: cells are aligned to multiples of the resolution in the sum
      [m].

    Returned: without any cell if there is no core point but noise. ValueError if shapes differ, a coordinate
    is not finite, or the resolution is 0 or gives too many cells.

    >>> import numpy as np
    >>> x, y = np.meshgrid(np.arange(0.5, 6.0), np.arange(0.5, 6.0))
    >>> house = (abs(x - 3) < 1) & (abs(y - 3) < 1)
    >>> points = np.column_stack((x.ravel(), y.ravel(), 5.0 * house.ravel()))
    >>> rasters = make_rasters(points, np.where(house.ravel(), 6, 2), RasterConfig(raster_resolution=1.0))
    >>> rasters.dtm.shape, float(rasters.dtm.max()), float(rasters.ndsm.max())
    ((6, 6), 0.0, 5.0)
    """
    config = config or RasterConfig()
    points = checked_points(points)
    classes = checked_column("classification", classification, len(points), np.uint8)
    core = _checked_or(np.ones, "is_core", is_core, len(points), np.bool_)
    first = _checked_or(np.zeros, "return_number", return_number, len(points), np.uint8) <= 1
    if config.raster_resolution <= 0.0:
        raise ValueError("raster_resolution = 0: must be above 0 to make rasters")
    kind, resolution = _KINDS[classes], config.raster_resolution
    own_extent, _ = _extents(points, kind, core, _EVERYWHERE)
    if own_extent[0, 0] > own_extent[1, 0]:
        nothing = np.zeros((0, 0), dtype=np.float32)
        return TerrainRasters(RasterWindow(resolution), nothing, nothing, nothing.astype(np.int32))
    margin = 2.0 * config.raster_reach + _MARGIN_CELLS * resolution
    _, extent = _extents(points, kind, core, own_extent + np.array([[-margin], [margin]]))
    if is_wide(extent, resolution):
        rows = np.flatnonzero(kind)
        kind[rows[~main_area(points[rows], 3.0 * config.raster_reach + _LEAST_SQUARE)]] = LEFT_OUT
        _, extent = _extents(points, kind, core, _EVERYWHERE)
    reach = reach_in_cells(config.raster_reach, resolution)
    cells = Cells(window_of(extent, origin, resolution).grown(reach + 1), origin)
    contents = cells.contents(points, kind, core, first)
    own, others, ground = contents.own, contents.others, contents.ground
    known = closed(own | others, reach)
    dtm = np.full(known.shape, np.nan, dtype=np.float32)
    dtm[ground.rows, ground.columns] = cells.levelled(ground)
    distance = squared_distance(own, reach)
    mine = known & (distance <= np.minimum(squared_distance(others, reach), reach * reach))
    gaps = regions_touching(known & np.isnan(dtm), mine)
    vertices, variance = ground.near(gaps), None
    if config.dtm_interpolation == KRIGING and len(vertices.points):
        variogram = fit_variogram(vertices.points)
        beside = variogram(np.array(resolution))
        variance = np.where(np.isnan(dtm), np.float32(np.nan), beside.astype(np.float32))
        dtm[gaps], variance[gaps] = cells.kriged_at(vertices, gaps, variogram)
    else:
        dtm[gaps] = cells.elevations_at(vertices, gaps, config.dtm_interpolation)
    seen = points if point_spacing is not None else points[kind != LEFT_OUT]
    spacing = given_or_measured(seen, point_spacing)
    gap = min(widest_gap(spacing, resolution), reach)
    dsm = surface_elevations(cells, contents, dtm, known, mine, gap)
    for raster in (dtm, dsm) if variance is None else (dtm, dsm, variance):
        raster[~mine] = np.nan
    return _cropped(TerrainRasters(cells.window, dtm, dsm, distance, variance), mine)


def _checked_or(missing, name: str, column: ArrayLike | None, n: int, dtype) -> NDArray:  # type: ignore[no-untyped-def]
    return missing(n, dtype=dtype) if column is None else checked_column(name, column, n, dtype)


def _cropped(rasters: TerrainRasters, known: NDArray[np.bool_]) -> TerrainRasters:
    """Return the rasters without the outer rows and columns that hold no known cell."""
    rows, columns = (_span(known.any(axis=axis)) for axis in (1, 0))
    variance = rasters.dtm_variance
    cut = None if variance is None else variance[rows, columns].copy()
    dtm, dsm = (each[rows, columns].copy() for each in (rasters.dtm, rasters.dsm))
    distance = rasters.distance[rows, columns].copy()
    return TerrainRasters(rasters.window.part(columns, rows), dtm, dsm, distance, cut)


def _span(marked: Any) -> slice:
    at = np.flatnonzero(marked)
    return slice(int(at[0]), int(at[-1]) + 1) if len(at) else slice(0, 0)


@kernel
def _extents(points, kind, is_core, limits):  # type: ignore[no-untyped-def]
    """Leave out what lies beyond limits; return the extents of the core's points and of all that are left."""
    # Arrays of shape (2, 2): least and greatest x and y [m]; infinite where there is no point.
    own, every = np.empty((2, 2)), np.empty((2, 2))
    for extent in (own, every):
        extent[0], extent[1] = np.inf, -np.inf
    for i in range(len(points)):
        if kind[i] == LEFT_OUT:
            continue
        for axis in range(2):
            if not limits[0, axis] <= points[i, axis] <= limits[1, axis]:
                kind[i] = LEFT_OUT
        if kind[i] == LEFT_OUT:
            continue
        for axis in range(2):
            place = points[i, axis]
            every[0, axis], every[1, axis] = min(every[0, axis], place), max(every[1, axis], place)
            if is_core[i]:
                own[0, axis], own[1, axis] = min(own[0, axis], place), max(own[1, axis], place)
    return own, every


def is_wide(extent: NDArray[np.float64], resolution: float) -> bool:
    """Whether a window of cells round an extent, shape (2, 2) [m], is too large to be nearly empty."""
    return bool(np.prod(np.diff(extent, axis=0) / resolution) > _SMALL)


def main_area(points: NDArray[np.float64], square: float) -> NDArray[np.bool_]:
    """
    Tell which points a window of cells is worth its memory for: mostly all.

    A single point 10 km from a tile would make a window of gigabytes. Where it would be nearly empty the
    group of adjoining squares with the most points is kept; of equal ones the westernmost, then southernmost.
    """
    squares, at, count = np.unique(
        np.floor(points[:, :2] / square).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    wide, high = (squares.max(axis=0) - squares.min(axis=0) + 1).tolist()
    if wide * high <= _SPARSITY * len(squares):
        return np.ones(len(points), dtype=bool)
    group = sets_of_pairs(len(squares), *cKDTree(squares).query_pairs(1.5, output_type="ndarray").T)
    return np.asarray(group[at.ravel()] == np.argmax(np.bincount(group, weights=count)))


# Chosen by hand on Delft, fusa and Toronto (doc/algorithms/terrain.md).
#: Empty circles up to this radius are chance, not water: so many spacings, and at least so many metres.
_GAP_SPACINGS, _MIN_GAP = 3.0, 1.5
#: A hole lies on the ground if so great a share of the cells round it have points less high than this [m].
_LOW_SHARE, _LOW = 0.05, 1.0


def widest_gap(point_spacing: float, resolution: float) -> int:
    """Return the radius of the largest circle, in cells, that is empty by chance: a gap, and no hole."""
    return reach_in_cells(max(_GAP_SPACINGS * point_spacing, _MIN_GAP), resolution)


def surface_elevations(
    cells: Cells,
    contents: CellContents,
    ground: NDArray[np.float32],
    known: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
    gap: int,
) -> NDArray[np.float32]:
    """
    Return the elevation of the surface at the cells that are wanted [m], others' or NaN elsewhere.

    A cell with first returns has the highest of them; where there is none near, later returns stand in. Gaps,
    see `widest_gap`, between such cells are closed by the TIN of the highest points round them. Wider holes
    returned nothing: water and shadow mostly, which take the ground's elevation even where trees line them. A
    hole that only high cells surround is a wet or dark roof, and is closed like a gap. On each side are at
    least as many empty cells as a gap is wide.
    """
    first, later = contents.first, contents.later
    lacking = ~closed(first.mask(cells.window.shape), gap)[later.rows, later.columns]
    highest = first.joined(later.select(lacking))
    measured = highest.mask(cells.window.shape)
    on_ground = _holes_on_ground(contents.lowest, ground, known & ~closed(measured, gap))
    elevation = np.where(on_ground, ground, np.float32(np.nan))
    gaps = regions_touching(known & ~measured & ~on_ground, wanted)
    elevation[gaps] = np.fmax(cells.elevations_at(highest.near(gaps), gaps), ground[gaps])
    elevation[highest.rows, highest.columns] = highest.points[:, 2]
    elevation[~known] = np.nan
    return elevation


def _holes_on_ground(
    lowest: CellPoints, ground: NDArray[np.float32], holes: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return the cells of those holes round which the ground was seen."""
    number, n_holes = ndimage.label(holes, ADJACENT)
    beside = ndimage.maximum_filter(number, footprint=ADJACENT)[lowest.rows, lowest.columns]
    height = lowest.points[:, 2] - ground[lowest.rows, lowest.columns]
    n_beside = np.bincount(beside, minlength=n_holes + 1)
    n_low = np.bincount(beside[height < _LOW], minlength=n_holes + 1)
    is_on_ground = n_low > _LOW_SHARE * n_beside
    is_on_ground[0] = False
    return is_on_ground[number]
