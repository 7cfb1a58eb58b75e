"""A piece of terrain under the scanner: what the scenes of terrain_scenes.py are built from."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.scenes.kit import scan_rows

#: Elevation of level ground [m].
GROUND = 50.0
#: Share of the pulses at a roof's edge that hit the wall instead, and how far the edge reaches inwards [m].
WALL_SHARE = 0.5
WALL_WIDTH = 0.25
#: Returns from walls lie at least this high above the terrain, where their truth is beyond doubt [m].
WALL_FOOT = 0.5

Array = NDArray[np.float64]


class TerrainScene(NamedTuple):
    """Points and which of them are ground."""

    points: Array
    is_ground: NDArray[np.bool_]


class TerrainSite:
    """
    Pulses over a rectangle, one return each: of the terrain first, then of what is put upon it.

    The rectangle is `width` by `depth` [m] from (0, 0), with `density` [pts/m²]; the seed is that of the
    pulses' positions and of everything random upon the site (`random`). `elevation` gives that of the terrain
    at x and y; level ground without it.
    """

    def __init__(
        self,
        width: float,
        depth: float,
        density: float,
        seed: int,
        elevation: Callable[[Array, Array], Array] | None = None,
    ):
        self.random = np.random.default_rng(seed)
        self.size = np.array([width, depth])
        xy = scan_rows(np.zeros(2), self.size, density, self.random)
        self.x, self.y = xy[(xy < self.size).all(axis=1)].T
        self.terrain = GROUND + (0 * self.x if elevation is None else elevation(self.x, self.y))
        self.z = self.terrain.copy()
        self.is_ground = np.ones(len(self.x), dtype=bool)

    def box(self, x: float, y: float, length: float, width: float, angle_deg: float = 0.0) -> Array:
        """How deep each pulse lies inside a rectangle about a middle [m]; negative outside."""
        angle = np.deg2rad(angle_deg)
        along = np.cos(angle) * (self.x - x) + np.sin(angle) * (self.y - y)
        across = np.cos(angle) * (self.y - y) - np.sin(angle) * (self.x - x)
        return np.minimum(length / 2 - abs(along), width / 2 - abs(across))

    def disc(self, x: float, y: float, radius: float) -> Array:
        """How deep each pulse lies inside a circle [m]; negative outside."""
        return radius - np.hypot(self.x - x, self.y - y)

    def shape_terrain(self, inside: NDArray, elevation: Array | float) -> None:
        """Give the terrain another elevation somewhere; what stands there is gone."""
        self.terrain = np.where(inside, elevation, self.terrain)
        self.z = np.where(inside, self.terrain, self.z)
        self.is_ground |= inside

    def put(self, depth: Array, top: Array | float, *, walls: bool = True) -> None:
        """Put something solid where `depth` > 0; where the terrain lies higher than its top, that is seen."""
        top = np.broadcast_to(top, depth.shape)
        rows = (depth > 0) & (top >= self.terrain)
        self.z[rows], self.is_ground[rows] = top[rows], False
        edge = rows & walls & (depth < WALL_WIDTH) & (top - self.terrain > 2 * WALL_FOOT)
        edge &= self.random.random(len(edge)) < WALL_SHARE
        share = self.random.random(len(edge))
        foot = self.terrain + WALL_FOOT
        self.z[edge] = (foot + share * (top - foot))[edge]

    def house(
        self,
        x: float,
        y: float,
        length: float,
        width: float,
        eave: float,
        ridge: float,
        angle_deg: float = 0.0,
    ) -> None:
        """Put a house with a hip roof: heights above the terrain in its middle [m]."""
        depth = self.box(x, y, length, width, angle_deg)
        nearest = np.argmin(np.hypot(self.x - x, self.y - y))
        rise = (ridge - eave) * np.clip(depth / (width / 2), 0, 1)
        self.put(depth, self.terrain[nearest] + eave + rise)

    def grow(self, share: float, low: float, high: float, where: NDArray | bool = True) -> None:
        """
        Let a share of the pulses on bare ground end in plants between two heights above the terrain [m].
        """
        rows = self.is_ground & where & (self.random.random(len(self.z)) < share)
        heights = self.random.uniform(low, high, len(self.z))
        self.z[rows], self.is_ground[rows] = (self.terrain + heights)[rows], False

    def tree(self, x: float, y: float, radius: float, height: float, penetration: float = 0.3) -> None:
        """
        Plant a tree: a share of the pulses reach what lies below its crown, the others end within the crown.
        """
        depth = self.disc(x, y, radius)
        rows = (depth > 0) & (self.random.random(len(depth)) >= penetration)
        top = np.sqrt(np.clip(1 - (1 - depth / radius) ** 2, 0, 1))
        share = 0.4 + 0.6 * top * self.random.random(len(depth)) ** 0.3
        self.z[rows] = (self.terrain + height * share)[rows]
        self.is_ground[rows] = False

    def keep(self, rows: NDArray) -> None:
        """Leave the other pulses without a return."""
        for name in ("x", "y", "z", "terrain", "is_ground"):
            setattr(self, name, getattr(self, name)[rows])

    def add(self, points: Array) -> None:
        """Append points that are not ground."""
        self.x, self.y, self.z = (
            np.append(old, new) for old, new in zip((self.x, self.y, self.z), points.T, strict=True)
        )
        self.terrain = np.append(self.terrain, points[:, 2])
        self.is_ground = np.append(self.is_ground, np.zeros(len(points), dtype=bool))

    def scanned(self, noise: float, rotation_deg: float) -> TerrainScene:
        """Measure: add noise along z, and turn the whole site about its middle."""
        angle = np.deg2rad(rotation_deg)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        middle = self.size / 2
        xy = (np.column_stack((self.x, self.y)) - middle) @ turn + middle
        z = self.z + self.random.normal(0, 1, len(self.z)) * noise
        return TerrainScene(np.column_stack((xy, z)), self.is_ground.copy())


def waves(amplitude: float, wavelength: float) -> Callable[[Array, Array], Array]:
    """Terrain that undulates in two directions [m]."""
    number = 2 * np.pi / wavelength
    return lambda x, y: (
        amplitude * (np.sin(number * (x + 0.4 * y)) + 0.6 * np.cos(number * (0.7 * y - 0.3 * x)))
    )


def ramp(value: Array, start: float, end: float) -> Array:
    """Rise evenly from 0 at `start` to 1 at `end`."""
    return np.clip((value - start) / (end - start), 0, 1)
