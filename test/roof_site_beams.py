"""
Beams over a site: what is hit first, what else lies in the footprint, what leaves and sheets return.

"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Elevation = Callable[[Array, Array], Array]

#: Side of the raster in which beams are followed [m]; where they end is then computed exactly.
CELL = 0.125
#: Raster around the outermost beams [m].
MARGIN = 3.0
#: Highest thing that leaning beams are followed from [m].
MAX_HEIGHT = 80.0
#: A beam that enters a thing this far below its top has met a wall [m].
WALL_DEPTH = 0.05
#: How far steep roofs may lie above the middles of their cells [m].
RASTER_ERROR = 0.5
#: Halvings of the way between two levels, and rounds until a beam's end on a slope is found.
BISECTIONS, SURFACE_ROUNDS = 12, 6
#: Radius of a beam's footprint [m], and the least distance of two returns [m].
FOOTPRINT = 0.2
MIN_SEPARATION = 1.2
#: Most returns of a pulse, and most of them from one crown.
MAX_RETURNS, MAX_LEAVES = 5, 3


class Crown(NamedTuple):
    """
    A tree's crown: an ellipsoid [m], mean paths to the first leaf and between leaves, and what passes a leaf.

    """

    x: float
    y: float
    z: float
    radius: float
    half_height: float
    kind: int
    first_leaf: float = 0.5
    leaf_distance: float = 1.5
    passes: float = 0.6


class Sheet(NamedTuple):
    """
    A level sheet with holes: crane jibs, awnings, nets, glass.

    """

    depth: Elevation
    elevation: float
    echo: float
    passes: float
    kind: int


class Hits(NamedTuple):
    """
    Returns in the order of pulses, the highest of each first.

    Attributes
    ----------
    points : ndarray of shape (n, 3)
        [m].
    number, of : ndarray of uint8
        Return number, and number of returns.
    kind, layer : ndarray of int64
        What was hit; which of the things put there.
    is_wall : ndarray of bool
        Whether its side was hit, not its top.
    foot_kind : ndarray of int64
        At a wall: what lies at its foot.
    below_top : ndarray
        At a wall: how far below its top [m].

    """

    points: Array
    number: NDArray[np.uint8]
    of: NDArray[np.uint8]
    kind: NDArray[np.int64]
    layer: NDArray[np.int64]
    is_wall: NDArray[np.bool_]
    foot_kind: NDArray[np.int64]
    below_top: Array


class World:
    """
    Terrain and solid things upon it, each known by its depth inside, its top and its kind.

    """

    def __init__(self, terrain: Elevation):
        self.terrain = terrain
        self.layers: list[tuple[Elevation | None, Elevation, int]] = [(None, terrain, 0)]

    def add(self, depth: Elevation, top: Elevation, kind: int) -> None:
        """
        Add a solid thing.

        """
        self.layers.append((depth, top, kind))

    def rasters(self, low: Array, high: Array) -> tuple[Array, NDArray[np.int64]]:
        """
        Return the highest elevation in each cell (row, column), and which layer it is.

        """
        steps = [np.arange(a + CELL / 2, b, CELL) for a, b in zip(low, high, strict=True)]
        x, y = np.meshgrid(*steps)
        top, label = self.terrain(x, y), np.zeros(x.shape, dtype=np.int64)
        for number, (depth, elevation, _) in enumerate(self.layers[1:], start=1):
            rows = np.flatnonzero(depth(x, y).ravel() > 0)
            z = elevation(x.ravel()[rows], y.ravel()[rows])
            rows, z = rows[z > top.ravel()[rows]], z[z > top.ravel()[rows]]
            top.ravel()[rows], label.ravel()[rows] = z, number
        return top, label

    def kinds(self, layer: NDArray[np.int64]) -> NDArray[np.int64]:
        """
        Return the kind of each layer number.

        """
        return np.array([kind for _, _, kind in self.layers])[layer]


def returns_of(
    world: World,
    crowns: list[Crown],
    sheets: list[Sheet],
    x: Array,
    y: Array,
    lean: Array,
    random: np.random.Generator,
) -> Hits:
    """
    Send beams that lean along y and return what comes back.

    """
    turn = random.uniform(0, 2 * np.pi, len(x))
    axis = _Beams(x, y, lean, float(world.terrain(x, y).mean()))
    beside = axis._replace(x=x + FOOTPRINT * np.cos(turn), y=y + FOOTPRINT * np.sin(turn))
    solid, rim = _solids(world, [axis, beside], random)
    echoes = [_leaves(crown, axis, solid.z, random) for crown in crowns]
    echoes += [_sheet(sheet, axis, solid.z, random) for sheet in sheets]
    weak = np.ones(len(x))
    for echo in echoes:
        weak *= echo.left
    reached = random.random(len(x)) < weak
    apart = reached & (abs(solid.z - rim.z) > MIN_SEPARATION)
    z = np.column_stack(
        [*(echo.z for echo in echoes), np.where(reached, solid.z, np.nan), np.where(apart, rim.z, np.nan)]
    )
    fixed = [np.full((len(x), echo.z.shape[1]), echo.kind) for echo in echoes]
    layer = np.column_stack([*(0 * kind for kind in fixed), solid.layer, rim.layer])
    kind = np.column_stack([*fixed, world.kinds(solid.layer), world.kinds(rim.layer)])
    no = [np.zeros(kind.shape, dtype=bool) for kind in fixed]
    is_wall = np.column_stack([*no, solid.is_wall, rim.is_wall])
    foot_kind = np.column_stack([*(0 * k for k in fixed), world.kinds(solid.foot), world.kinds(rim.foot)])
    below = np.column_stack([*(0.0 * k for k in fixed), solid.below_top, rim.below_top])
    return _listed(axis, z, (kind, layer, is_wall, foot_kind, below))


def _listed(axis: _Beams, z: Array, columns: tuple[NDArray, ...]) -> Hits:
    """
    Order each pulse's echoes by elevation, drop those that melt into the one before, and list the rest.

    """
    order = np.argsort(-np.where(np.isnan(z), -np.inf, z), axis=1, kind="stable")
    z = np.take_along_axis(z, order, axis=1)
    kept, last, count = np.zeros(z.shape, dtype=bool), np.full(len(z), np.inf), np.zeros(len(z), dtype=int)
    for column in range(z.shape[1]):
        kept[:, column] = (last - z[:, column] >= MIN_SEPARATION) & (count < MAX_RETURNS)
        last = np.where(kept[:, column], z[:, column], last)
        count += kept[:, column]
    pulse = np.nonzero(kept)[0]
    kind, layer, is_wall, foot_kind, below = (
        np.take_along_axis(values, order, axis=1)[kept] for values in columns
    )
    chosen = z[kept]
    beams = axis.of(pulse)
    points = np.column_stack([beams.x, beams.y_at(chosen), chosen])
    number = np.cumsum(kept, axis=1)[kept].astype(np.uint8)
    return Hits(points, number, count[pulse].astype(np.uint8), kind, layer, is_wall, foot_kind, below)


class _Beams(NamedTuple):
    """
    Where beams pass an elevation [m], and how they lean along y.

    """

    x: Array
    y: Array
    lean: Array
    base: float

    def y_at(self, z: Array) -> Array:
        """
        Return y at an elevation.

        """
        return self.y + self.lean * (z - self.base)

    def of(self, rows: NDArray[np.int64]) -> _Beams:
        """
        Return some of the beams.

        """
        return self._replace(x=self.x[rows], y=self.y[rows], lean=self.lean[rows])


class _Solid(NamedTuple):
    """
    Where beams end: elevation, layer, whether at a wall, the layer at its foot, how far below its top.

    """

    z: Array
    layer: NDArray[np.int64]
    is_wall: NDArray[np.bool_]
    foot: NDArray[np.int64]
    below_top: Array


def _solids(world: World, beams: list[_Beams], random: np.random.Generator) -> list[_Solid]:
    """
    Follow beams through the raster.

    """
    axis = beams[0]
    steepest = abs(axis.lean).max()
    corners = np.array([[f(axis.x), f(axis.y)] for f in (np.min, np.max)])
    reach = np.array([MARGIN, MARGIN + steepest * MAX_HEIGHT])
    top, label = world.rasters(corners[0] - reach, corners[1] + reach)
    highest, lowest = top.max() + 0.5, top.min() - 0.5
    n_steps = max(1, int(np.ceil(steepest * (highest - lowest) / CELL)))
    step = (highest - lowest) / n_steps
    # Each beam has levels of its own, so that walls are not hit in rows.
    levels = highest + step * (random.random(len(axis.x)) - np.arange(n_steps + 2)[:, None])
    return [_followed(world, beam, levels, corners[0] - reach, top, label) for beam in beams]


def _followed(
    world: World,
    beam: _Beams,
    levels: Array,
    corner: Array,
    top: Array,
    label: NDArray[np.int64],
) -> _Solid:
    """
    Follow beams down, level by level, until they are below the top of the cell that they are over.

    """
    column = np.clip(((beam.x - corner[0]) / CELL).astype(int), 0, top.shape[1] - 1)
    going = np.ones(len(column), dtype=bool)
    over, met = np.zeros((2, len(column)), dtype=np.int64)
    z_free, z_met = np.full((2, len(column)), np.inf)
    for z in levels:
        row = np.clip(((beam.y_at(z) - corner[1]) / CELL).astype(int), 0, top.shape[0] - 1)
        cell = row * top.shape[1] + column
        hit = going & (top.ravel()[cell] >= z)
        met, z_met = np.where(hit, cell, met), np.where(hit, z, z_met)
        going &= ~hit
        over, z_free = np.where(going, cell, over), np.where(going, z, z_free)
    layer = label.ravel()[met]
    found = _Solid(np.empty(len(layer)), layer, going.copy(), label.ravel()[over], np.zeros(len(layer)))
    for number in np.unique(layer):
        rows = np.flatnonzero(layer == number)
        _end(world, number, beam.of(rows), z_free[rows], z_met[rows], top.ravel()[met[rows]], rows, found)
    return found


def _end(world, number, beam, z_free, z_met, z, rows, found) -> None:
    """
    Compute where beams end on one thing: at its side where they enter it below its top, else on its top.

    """
    depth, elevation, _ = world.layers[number]
    if depth is not None:
        outside, inside = z_free.copy(), z_met.copy()
        for _ in range(BISECTIONS):
            middle = (outside + inside) / 2
            within = depth(beam.x, beam.y_at(middle)) > 0
            inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
        # A cell is in or out by its middle: a beam may be within the thing before it meets its cell.
        above_free = elevation(beam.x, beam.y_at(z_free)) - z_free
        within = depth(beam.x, beam.y_at(z_free)) > 0
        inside = np.where(within, z_free, inside)
        entered = ~within | (above_free > RASTER_ERROR)
        below = np.where(entered, elevation(beam.x, beam.y_at(inside)) - inside, 0.0)
        found.is_wall[rows], found.below_top[rows] = below > WALL_DEPTH, np.maximum(below, 0.0)
    for _ in range(SURFACE_ROUNDS):
        z = elevation(beam.x, beam.y_at(z))
    found.z[rows] = z if depth is None else np.where(found.is_wall[rows], inside, z)


class _Echo(NamedTuple):
    """
    Elevations of echoes from one thing, NaN for none; the share of light left behind it; its kind.

    """

    z: Array
    left: Array
    kind: int


def _leaves(crown: Crown, axis: _Beams, solid: Array, random: np.random.Generator) -> _Echo:
    """
    Echoes of leaves between where beams enter and leave a crown.

    """
    dx, dy = (axis.x - crown.x) / crown.radius, (axis.y_at(crown.z) - crown.y) / crown.radius
    step = axis.lean / crown.radius
    a, half_b, c = step**2 + 1 / crown.half_height**2, dy * step, dx**2 + dy**2 - 1
    discriminant = half_b**2 - a * c
    root = np.sqrt(np.clip(discriminant, 0, None))
    entry, leaving = crown.z + (root - half_b) / a, crown.z - (root + half_b) / a
    z = np.full((len(dx), MAX_LEAVES), np.nan)
    level = entry - crown.first_leaf * random.exponential(size=len(dx))
    left = np.ones(len(dx))
    for leaf in range(MAX_LEAVES):
        there = (discriminant > 0) & (level > leaving) & (level > solid + MIN_SEPARATION)
        z[:, leaf] = np.where(there, level, np.nan)
        left *= np.where(there, crown.passes, 1.0)
        level = level - MIN_SEPARATION - crown.leaf_distance * random.exponential(size=len(dx))
    return _Echo(z, left, crown.kind)


def _sheet(sheet: Sheet, axis: _Beams, solid: Array, random: np.random.Generator) -> _Echo:
    """
    Echoes of a sheet.

    """
    inside = sheet.depth(axis.x, axis.y_at(sheet.elevation)) > 0
    there = inside & (sheet.elevation > solid + 0.1) & (random.random(len(solid)) < sheet.echo)
    z = np.where(there, sheet.elevation, np.nan)[:, None]
    return _Echo(z, np.where(there, sheet.passes, 1.0), sheet.kind)
