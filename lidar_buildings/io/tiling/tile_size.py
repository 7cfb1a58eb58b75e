"""The tiles that suit a survey, and the order in which its files are read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.io.clouds.agreement import agreed_system, in_true_units, shared_origin
from lidar_buildings.io.clouds.cloud import CloudExtent
from lidar_buildings.io.clouds.copc import read_nodes
from lidar_buildings.io.tiling.tile_grid import BUFFER_SHARES, MOST_TILES, Rectangle
from lidar_buildings.io.tiling.tiling_config import TilingConfig

#: Sides to choose from [m]; wider tiles bring nothing, and a survey that fills its bounds in parts would
#: surprise with them.
_SIZES = tuple(float(size) for size in range(1000, 49, -25))
#: Of the sides that fit, how much shorter than the largest one the last is that is tried.
_SHORTEST = 0.5
#: A buffer of half the width is taken where stages then see so many times fewer points; tiles grow more often
#: then.
_NARROW_GAIN = 1.4
#: Bounds as small as those of a single point are taken for this wide [m].
_SMALLEST = 1e-3


class TileCut(NamedTuple):
    """How a survey is cut into tiles."""

    size: float  #: side of a tile [m]
    start: float  #: where they begin: 0 or half the side [m]
    buffer: float  #: width of the strip of neighbours east of a tile [m]


def tiles_for(config: TilingConfig, bounds: NDArray[np.float64], counts: NDArray[np.float64]) -> TileCut:
    """
    Return how a survey is cut: as asked for, or as suits it, see `fitting_tiles`.

    Where points are dense, and tiles so small that most of what they hold is buffer, the buffer has half the
    width that is asked for.
    """
    if config.tile_size:
        return TileCut(config.tile_size, 0.0, config.buffer)
    wide, narrow = (
        fitting_tiles(bounds, counts, share * config.buffer, config.max_tile_points) for share in (1.0, 0.5)
    )
    seen, seen_narrow = (
        expected_points(bounds - cut.start, counts, cut.buffer, cut.size).sum() for cut in (wide, narrow)
    )
    return narrow if seen > _NARROW_GAIN * seen_narrow else wide


def spread_of(clouds: Iterable[CloudExtent]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return where the points of clouds lie, as far as that is known without reading any.

    Least and greatest x and y of files, of COPC of squares of its octree, shape (n, 2, 2) [m], and their
    points, shape (n,), which are taken to lie evenly in them. InputError if a hierarchy cannot be read.
    """
    bounds, counts = [np.empty((0, 2, 2))], [np.empty(0)]
    for cloud in clouds:
        if (area := Rectangle.of_cloud(cloud)) is not None:
            of_file, unit, nodes = bounds_of([area]), cloud.crs.horizontal_unit, read_nodes(cloud)
            own, held = (of_file, [cloud.point_count]) if nodes is None else nodes.squares(unit)
            own = own * (1.0 if nodes is None else unit)
            bounds.append(np.clip(own, of_file[:, :1], of_file[:, 1:]))
            counts.append(np.asarray(held, dtype=np.float64))
    return np.concatenate(bounds), np.concatenate(counts)


def fitting_tiles(
    bounds: NDArray[np.float64], counts: NDArray[np.float64], buffer: float, max_points: int
) -> TileCut:
    """
    Choose the side of a survey's tiles, and where they begin, of bounds and counts as of `spread_of`.

    Of the sides with which each tile, buffer included, is expected to hold at most `max_points` the one with
    which stages see the fewest points, taking those of bounds to lie evenly in them. Tiles begin at multiples
    of their side, as files of a survey do as a rule, or half-way between: what a vehicle measures lies about
    the origin of its frame, and all of it would be in the buffers of four tiles. `buffer` is the width of the
    strip of neighbours east of a tile [m].
    """
    chosen, least, shortest = TileCut(_SIZES[-1], 0.0, buffer), np.inf, 0.0
    for size in _SIZES:
        if size < shortest:
            break
        for start in (0.0, 0.5 * size):
            expected = expected_points(bounds - start, counts, buffer, size)
            if expected.max(initial=0.0) <= max_points:
                shortest = shortest or _SHORTEST * size
                if expected.sum() < least:
                    chosen, least = TileCut(size, start, buffer), float(expected.sum())
    return chosen


def bounds_of(areas: Sequence[Rectangle]) -> NDArray[np.float64]:
    """Return least and greatest x and y of each area, shape (n, 2, 2) [m]; none is without extent."""
    bounds = np.array(areas, dtype=np.float64).reshape(-1, 2, 2)
    bounds[:, 1] = np.maximum(bounds[:, 1], bounds[:, 0] + _SMALLEST)
    return bounds


def expected_points(
    bounds: NDArray[np.float64], counts: NDArray[np.float64], buffer: float, size: float
) -> NDArray[np.float64]:
    """Return how many points each tile is expected to hold, buffer included; bounds are as of `spread_of`."""
    before, after = buffer * np.array(BUFFER_SHARES).reshape(2, 2)
    first = np.floor((bounds[:, 0] - after) / size)
    spans = np.floor((bounds[:, 1] + before) / size) - first + 1.0
    is_told = spans.prod(axis=1) <= MOST_TILES
    bounds, counts, first = bounds[is_told], counts[is_told], first[is_told]
    width, height = spans[is_told].astype(np.int64).T
    file = np.repeat(np.arange(len(counts)), width * height)  # a row for each tile near each file
    place = np.arange(len(file)) - np.repeat(np.cumsum(width * height) - width * height, width * height)
    tiles = first[file] + np.column_stack(np.divmod(place, height[file]))
    low, high = bounds[file, 0], bounds[file, 1]
    within = np.minimum(high, (tiles + 1.0) * size + after) - np.maximum(low, tiles * size - before)
    points = counts[file] * (np.maximum(within, 0.0) / (high - low)).prod(axis=1)
    is_core = ((tiles * size <= high) & (low < (tiles + 1.0) * size)).all(axis=1)
    column, row = (tiles - tiles.min(axis=0, initial=np.inf)).T
    number = np.unique(column * (row.max(initial=0.0) + 1.0) + row, return_inverse=True)[1]
    has_core = np.bincount(number[is_core], minlength=number.max(initial=-1) + 1) > 0
    return np.bincount(number, points)[has_core]


#: Bits of a place along the Z-curve.
_BITS = 21


def reading_order(areas: Sequence[Rectangle | None]) -> list[int]:
    """Order files by the Z-curve (Morton 1966) through their middles, those without points (None) first."""
    empty = [i for i, area in enumerate(areas) if area is None]
    filled = [(i, area) for i, area in enumerate(areas) if area is not None]
    north, east = bounds_of([area for _, area in filled]).mean(axis=1).T[::-1]
    places = np.column_stack([north, east])
    low, high = places.min(axis=0, initial=np.inf), places.max(axis=0, initial=-np.inf)
    side = float(np.max(high - low)) or 1.0
    cells = np.minimum((places - low) / side * 2**_BITS, 2**_BITS - 1).astype(np.int64)
    bits = ((cells[:, axis] >> bit & 1) << 2 * bit + axis for bit in range(_BITS) for axis in (0, 1))
    codes = sum(bits, np.zeros(len(filled), dtype=np.int64))
    return empty + [filled[k][0] for k in np.argsort(codes, kind="stable")]


@dataclass(frozen=True, eq=False)
class SurveyPlan:
    """A survey and its tiles."""

    n_files: int
    n_points: int
    n_bytes: int
    system: str  #: reference system, empty if no file says
    bounds: tuple[float, float, float, float]  #: least x and y, greatest x and y [m]
    area: float  #: what the bounds of the files cover [m²]
    tile_size: float  #: side of the tiles [m]
    #: Expected points of each tile, and what it covers [m²], buffer included, shape (n_tiles,).
    tile_points: NDArray[np.float64]
    tile_areas: NDArray[np.float64]

    @property
    def n_tiles(self) -> int:
        """Number of tiles."""
        return len(self.tile_points)


def plan_survey(
    clouds: Sequence[CloudExtent], config: TilingConfig, within: Sequence[float] | None = None
) -> SurveyPlan:
    """
    Cut a survey, or what of it is within bounds, into tiles as a run does.

    The points of a file are taken to lie evenly in its bounds, those of COPC in the squares of its octree.
    InputError if a run would not take these files together.
    """
    system = agreed_system(clouds)
    clouds = in_true_units(clouds, system.crs.name)
    system = replace(system, crs=replace(system.crs, horizontal_unit=clouds[0].crs.horizontal_unit))
    shared_origin(clouds)
    filled = [cloud for cloud in clouds if cloud.point_count]
    files = bounds_of([area for cloud in filled if (area := Rectangle.of_cloud(cloud)) is not None])
    sizes = np.array([cloud.state[0] for cloud in filled], dtype=np.float64)
    places, counts = spread_of(filled)
    if within is not None:
        limits = np.array(within).reshape(2, 2) * system.crs.horizontal_unit
        (files, sizes), (places, counts) = _cut(files, sizes, limits), _cut(places, counts, limits)
    size, start, buffer = tiles_for(config, places, counts)
    extents = np.prod(files[:, 1] - files[:, 0], axis=1)
    covered = float(shapely.union_all(shapely.box(*files[:, 0].T, *files[:, 1].T)).area)
    around = [files[:, 0].min(axis=0), files[:, 1].max(axis=0)] if len(files) else np.zeros((2, 2))
    west, south, east, north = np.ravel(around).tolist()
    return SurveyPlan(
        len(clouds) if within is None else len(files),
        round(counts.sum()),
        round(sizes.sum()),
        system.crs.name,
        (west, south, east, north),
        covered,
        size,
        expected_points(places - start, counts, buffer, size),
        expected_points(files - start, extents, buffer, size) * covered / max(extents.sum(), 1e-9),
    )


def _cut(
    bounds: NDArray[np.float64], counts: NDArray[np.float64], limits: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what of places is within limits, and of what lies evenly in each its share."""
    cut = np.clip(bounds, *limits)
    share = np.prod((cut[:, 1] - cut[:, 0]) / (bounds[:, 1] - bounds[:, 0]), axis=1)
    return cut[share > 0.0], (counts * share)[share > 0.0]
