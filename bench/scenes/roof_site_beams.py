"""Beams over a site: followed from above to what they meet first."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

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
#: Places along each side at which the relief is looked for.
RELIEF_STEPS = 100
#: How far steep roofs may lie above the middles of their cells [m].
RASTER_ERROR = 0.5
#: Halvings of the way between two levels, and rounds until a beam's end on a slope is found.
BISECTIONS, SURFACE_ROUNDS = 12, 6


class Shape(Protocol):
    """What things look like from above."""

    def depth(self, x: Array, y: Array) -> Array:
        """How deep positions lie inside; negative outside."""

    def extent(self) -> tuple[float, float, float]:
        """Middle, and how far from it the shape reaches."""


class World:
    """Terrain and solid things upon it, each known by its depth inside, its top and its kind."""

    def __init__(self, terrain: Elevation):
        self.terrain = terrain
        self.layers: list[tuple[Shape | None, Elevation, int]] = [(None, terrain, 0)]

    def add(self, shape: Shape, top: Elevation, kind: int) -> None:
        """Add a solid thing."""
        self.layers.append((shape, top, kind))

    def rasters(self, low: Array, high: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return the highest elevation in each cell (row, column), and which layer it is."""
        x, y = (np.arange(a + CELL / 2, b, CELL) for a, b in zip(low, high, strict=True))
        top = self.terrain(*np.meshgrid(x, y))
        label = np.zeros(top.shape, dtype=np.int64)
        for number, (shape, elevation, _) in enumerate(self.layers):
            if shape is None:
                continue
            middle_x, middle_y, reach = shape.extent()
            columns = slice(*np.searchsorted(x, (middle_x - reach, middle_x + reach)))
            rows = slice(*np.searchsorted(y, (middle_y - reach, middle_y + reach)))
            here = np.meshgrid(x[columns], y[rows])
            z = elevation(*here)
            seen = (shape.depth(*here) > 0) & (z > top[rows, columns])
            top[rows, columns][seen], label[rows, columns][seen] = z[seen], number
        return top, label

    def relief(self, width: float, length: float) -> float:
        """Return the height of the highest thing above the lowest terrain of a rectangle [m]."""
        steps = np.linspace(0, width, RELIEF_STEPS), np.linspace(0, length, RELIEF_STEPS)
        x, y = np.meshgrid(*steps)
        tops = [top(x, y)[shape.depth(x, y) > 0] for shape, top, _ in self.layers if shape is not None]
        terrain = self.terrain(x, y)
        return float(np.concatenate([terrain.ravel(), *tops]).max() - terrain.min())

    def kinds(self, layer: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the kind of each layer number."""
        return np.array([kind for _, _, kind in self.layers])[layer]


class Beams(NamedTuple):
    """Where beams pass an elevation [m], and how they lean along y."""

    x: Array
    y: Array
    lean: Array
    base: float

    def y_at(self, z: Array) -> Array:
        """Return y at an elevation."""
        return self.y + self.lean * (z - self.base)

    def of(self, rows: NDArray[np.int64]) -> Beams:
        """Return some of the beams."""
        return self._replace(x=self.x[rows], y=self.y[rows], lean=self.lean[rows])


class Solid(NamedTuple):
    """Where beams end: elevation, layer, whether at a wall, the layer at its foot, how far below its top."""

    z: Array
    layer: NDArray[np.int64]
    is_wall: NDArray[np.bool_]
    foot: NDArray[np.int64]
    below_top: Array


def solids_of(world: World, beams: list[Beams], random: np.random.Generator) -> list[Solid]:
    """Follow beams through the raster."""
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
    beam: Beams,
    levels: Array,
    corner: Array,
    top: Array,
    label: NDArray[np.int64],
) -> Solid:
    """Follow beams down, level by level, until they are below the top of the cell that they are over."""
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
    found = Solid(np.empty(len(layer)), layer, going.copy(), label.ravel()[over], np.zeros(len(layer)))
    for number in np.unique(layer):
        rows = np.flatnonzero(layer == number)
        _end(world, number, beam.of(rows), z_free[rows], z_met[rows], top.ravel()[met[rows]], rows, found)
    return found


def _end(world, number, beam, z_free, z_met, z, rows, found) -> None:
    """
    Compute where beams end on one thing: at its side where they enter it below its top, else on its top.
    """
    shape, elevation, _ = world.layers[number]
    if shape is not None:
        outside, inside = z_free.copy(), z_met.copy()
        for _ in range(BISECTIONS):
            middle = (outside + inside) / 2
            within = shape.depth(beam.x, beam.y_at(middle)) > 0
            inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
        # A cell is in or out by its middle: a beam may be within the thing before it meets its cell.
        above_free = elevation(beam.x, beam.y_at(z_free)) - z_free
        within = shape.depth(beam.x, beam.y_at(z_free)) > 0
        inside = np.where(within, z_free, inside)
        entered = ~within | (above_free > RASTER_ERROR)
        below = np.where(entered, elevation(beam.x, beam.y_at(inside)) - inside, 0.0)
        found.is_wall[rows], found.below_top[rows] = below > WALL_DEPTH, np.maximum(below, 0.0)
    for _ in range(SURFACE_ROUNDS):
        z = elevation(beam.x, beam.y_at(z))
    found.z[rows] = z if shape is None else np.where(found.is_wall[rows], inside, z)
