"""
From beams to returns: what they end at, what else lies in their footprint, what leaves and sheets give back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.scenes.roof_site_beams import Array, Beams, Shape, Solid, World, solids_of

#: Radius of a beam's footprint [m], and the least distance of two returns [m].
FOOTPRINT = 0.2
MIN_SEPARATION = 1.2
#: Most returns of a pulse, and most of them from one crown.
MAX_RETURNS, MAX_LEAVES = 5, 3
#: One echo: of which pulse, at which elevation, and of what, as in `Hits`.
ECHO = np.dtype(
    {
        "names": ["pulse", "z", "kind", "layer", "is_wall", "foot_kind", "below_top"],
        "formats": ["i8", "f8", "i8", "i8", "?", "i8", "f8"],
    }
)


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
    """A level sheet with holes: crane jibs, awnings, nets, glass."""

    shape: Shape
    elevation: float
    echo: float
    passes: float
    kind: int


class Hits(NamedTuple):
    """Returns in the order of pulses, the highest of each first."""

    points: Array  #: [m], shape (n, 3)
    #: Return number, and number of returns.
    number: NDArray[np.uint8]
    of: NDArray[np.uint8]
    #: What was hit; which of the things put there.
    kind: NDArray[np.int64]
    layer: NDArray[np.int64]
    is_wall: NDArray[np.bool_]  #: whether its side was hit, not its top
    foot_kind: NDArray[np.int64]  #: at a wall: what lies at its foot
    below_top: Array  #: at a wall: how far below its top [m]


def returns_of(
    world: World,
    crowns: list[Crown],
    sheets: list[Sheet],
    x: Array,
    y: Array,
    lean: Array,
    random: np.random.Generator,
) -> Hits:
    """Send beams that lean along y and return what comes back."""
    turn = random.uniform(0, 2 * np.pi, len(x))
    axis = Beams(x, y, lean, float(world.terrain(x, y).mean()))
    beside = axis._replace(x=x + FOOTPRINT * np.cos(turn), y=y + FOOTPRINT * np.sin(turn))
    solid, rim = solids_of(world, [axis, beside], random)
    left = np.ones(len(x))
    echoes = [_leaves(crown, axis, solid.z, left, random) for crown in crowns]
    echoes += [_sheet(sheet, axis, solid.z, left, random) for sheet in sheets]
    reached = random.random(len(x)) < left
    apart = reached & (abs(solid.z - rim.z) > MIN_SEPARATION)
    echoes += [_ends(world, solid, reached), _ends(world, rim, apart)]
    return _listed(axis, np.concatenate(echoes))


def _listed(axis: Beams, echoes: NDArray) -> Hits:
    """Order each pulse's echoes by elevation, drop those that melt into the one before, and list the rest."""
    echoes = echoes[np.lexsort((-echoes["z"], echoes["pulse"]))]
    begins = np.flatnonzero(np.diff(echoes["pulse"], prepend=-1))
    size = np.diff(np.append(begins, len(echoes)))
    last, count = np.full(len(begins), np.inf), np.zeros(len(begins), dtype=np.int64)
    number = np.zeros(len(echoes), dtype=np.int64)
    for place in range(size.max(initial=0)):
        pulses = np.flatnonzero(size > place)
        rows = begins[pulses] + place
        kept = (last[pulses] - echoes["z"][rows] >= MIN_SEPARATION) & (count[pulses] < MAX_RETURNS)
        pulses, rows = pulses[kept], rows[kept]
        count[pulses] += 1
        last[pulses], number[rows] = echoes["z"][rows], count[pulses]
    of = np.repeat(count, size)[number > 0]
    echoes, number = echoes[number > 0], number[number > 0]
    beams = axis.of(echoes["pulse"])
    points = np.column_stack([beams.x, beams.y_at(echoes["z"]), echoes["z"]])
    names = ("kind", "layer", "is_wall", "foot_kind", "below_top")
    return Hits(points, number.astype(np.uint8), of.astype(np.uint8), *(echoes[name] for name in names))


def _echoes(pulse: NDArray[np.int64], z: Array, kind: NDArray[np.int64] | int, **others: NDArray) -> NDArray:
    """Return rows of echoes."""
    rows = np.zeros(len(pulse), dtype=ECHO)
    rows["pulse"], rows["z"], rows["kind"] = pulse, z, kind
    for name, values in others.items():
        rows[name] = values
    return rows


def _ends(world: World, solid: Solid, reached: NDArray[np.bool_]) -> NDArray:
    """Echoes of what beams end at."""
    rows = np.flatnonzero(reached)
    return _echoes(
        rows,
        solid.z[rows],
        world.kinds(solid.layer[rows]),
        layer=solid.layer[rows],
        is_wall=solid.is_wall[rows],
        foot_kind=world.kinds(solid.foot[rows]),
        below_top=solid.below_top[rows],
    )


def _leaves(crown: Crown, axis: Beams, solid: Array, left: Array, random: np.random.Generator) -> NDArray:
    """
    Echoes of leaves between where beams enter and leave a crown; the light `left` behind them is reduced.
    """
    dx, dy = (axis.x - crown.x) / crown.radius, (axis.y_at(crown.z) - crown.y) / crown.radius
    step = axis.lean / crown.radius
    a, half_b, c = step**2 + 1 / crown.half_height**2, dy * step, dx**2 + dy**2 - 1
    rows = np.flatnonzero(half_b**2 > a * c)
    a, half_b, root = a[rows], half_b[rows], np.sqrt((half_b**2 - a * c)[rows])
    level, leaving = crown.z + (root - half_b) / a, crown.z - (root + half_b) / a
    level = level - crown.first_leaf * random.exponential(size=len(rows))
    found = []
    for _ in range(MAX_LEAVES):
        there = (level > leaving) & (level > solid[rows] + MIN_SEPARATION)
        found.append(_echoes(rows[there], level[there], crown.kind))
        left[rows[there]] *= crown.passes
        level = level - MIN_SEPARATION - crown.leaf_distance * random.exponential(size=len(rows))
    return np.concatenate(found)


def _sheet(sheet: Sheet, axis: Beams, solid: Array, left: Array, random: np.random.Generator) -> NDArray:
    """Echoes of a sheet; the light `left` behind them is reduced."""
    inside = sheet.shape.depth(axis.x, axis.y_at(sheet.elevation)) > 0
    rows = np.flatnonzero(inside & (sheet.elevation > solid + 0.1))
    rows = rows[random.random(len(rows)) < sheet.echo]
    left[rows] *= sheet.passes
    return _echoes(rows, np.full(len(rows), sheet.elevation), sheet.kind)
