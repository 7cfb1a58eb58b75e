"""Gross errors to put into a cloud whose ground is known: below it, as mirror images, as haze, as birds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.scenes.terrain_site import TerrainScene

Array = NDArray[np.float64]
#: Shallowest and deepest error below the ground [m].
DEPTHS = (1.0, 30.0)


def scattered(scene: TerrainScene, n: int, random: np.random.Generator, depths=DEPTHS) -> Array:
    """Points one by one, each somewhere at a depth of its own."""
    return _below(scene, _places(scene, n, random), random.uniform(*depths, n))


def sheet(scene: TerrainScene, n: int, random: np.random.Generator, depths=DEPTHS) -> Array:
    """Points one by one, all about as deep as one another: an echo that comes late by the same time."""
    depth = random.uniform(*depths) + random.normal(0.0, 0.05, n)
    return _below(scene, _places(scene, n, random), np.clip(depth, *depths))


def clusters(scene: TerrainScene, n: int, random: np.random.Generator, depths=DEPTHS) -> Array:
    """Points in groups of 5 to 300 within 0.5 to 4 m of one another in plan, each at a depth of its own."""
    sizes = _sizes(n, 5, 300, random)
    middles, number = _places(scene, len(sizes), random), np.repeat(np.arange(len(sizes)), sizes)
    reach = random.uniform(0.5, 4.0, len(sizes))[number]
    xy = middles[number] + random.uniform(-1.0, 1.0, (n, 2)) * reach[:, None]
    depth = random.uniform(*depths, len(sizes))[number] + random.uniform(-0.2, 0.2, n)
    return _below(scene, xy, np.clip(depth, *depths))


def lines(scene: TerrainScene, n: int, random: np.random.Generator, depths=DEPTHS) -> Array:
    """Points along lines of 10 to 50 m, a metre or less apart, each line at a depth of its own: multipath."""
    sizes = _sizes(n, 10, 100, random)
    starts, number = _places(scene, len(sizes), random), np.repeat(np.arange(len(sizes)), sizes)
    angle = random.uniform(0.0, 2.0 * np.pi, len(sizes))
    length = random.uniform(0.0, 1.0, n) * np.minimum(50.0, np.maximum(10.0, 0.5 * sizes))[number]
    along = np.column_stack((np.cos(angle), np.sin(angle)))[number]
    xy = starts[number] + length[:, None] * along + random.normal(0.0, 0.1, (n, 2))
    depth = random.uniform(*depths, len(sizes))[number] + random.uniform(-0.2, 0.2, n)
    return _below(scene, xy, np.clip(depth, *depths))


def mirrored(scene: TerrainScene, n: int, random: np.random.Generator, depths=DEPTHS) -> Array:
    """Mirror images of what stands on the ground, as far below it as it rises; else scattered points."""
    ground = _ground_at(scene, scene.points[:, :2])
    above = scene.points[:, 2] - ground
    rows = np.flatnonzero(~scene.is_ground & (above > depths[0] + 0.5) & (above < depths[1]))
    if len(rows) == 0:
        return scattered(scene, n, random, depths)
    rows = random.choice(rows, n)
    xy = scene.points[rows, :2] + random.normal(0.0, 0.2, (n, 2))
    return np.column_stack((xy, ground[rows] - above[rows]))


LOW_PATTERNS: dict[str, Callable[..., Array]] = {
    function.__name__: function for function in (scattered, sheet, clusters, lines, mirrored)
}


def haze(scene: TerrainScene, n: int, random: np.random.Generator, heights=(20.0, 120.0)) -> Array:
    """Points one by one, high in the air."""
    return _below(scene, _places(scene, n, random), -random.uniform(*heights, n))


def birds(scene: TerrainScene, n: int, random: np.random.Generator, heights=(25.0, 120.0)) -> Array:
    """One to three points at a time in the air."""
    sizes = _sizes(n, 1, 4, random)
    number = np.repeat(np.arange(len(sizes)), sizes)
    xy = _places(scene, len(sizes), random)[number] + random.uniform(-0.3, 0.3, (n, 2))
    return _below(scene, xy, -random.uniform(*heights, len(sizes))[number])


HIGH_PATTERNS: dict[str, Callable[..., Array]] = {"haze": haze, "birds": birds}


def _places(scene: TerrainScene, n: int, random: np.random.Generator) -> Array:
    """Positions of points drawn at random, so that there are errors only where there are points."""
    return scene.points[random.integers(0, len(scene.points), n), :2] + random.normal(0.0, 0.1, (n, 2))


def _sizes(n: int, least: int, end: int, random: np.random.Generator) -> NDArray[np.int64]:
    """Draw sizes of groups, small ones more often, until there are n points."""
    sizes = np.exp(random.uniform(np.log(least), np.log(end), n)).astype(np.int64)
    sizes = np.maximum(sizes, 1)[: np.searchsorted(np.cumsum(np.maximum(sizes, 1)), n) + 1]
    sizes[-1] -= sizes.sum() - n
    return sizes


def _below(scene: TerrainScene, xy: Array, depth: Array) -> Array:
    """Put points below the ground; what would lie beyond the scene is thrown back into it."""
    low, high = scene.points[:, :2].min(axis=0), scene.points[:, :2].max(axis=0)
    xy = low + (high - low) - np.abs((xy - low) % (2.0 * (high - low)) - (high - low))
    return np.column_stack((xy, _ground_at(scene, xy) - depth))


def _ground_at(scene: TerrainScene, xy: Array) -> Array:
    """Elevation of the nearest true ground [m]."""
    ground = scene.points[scene.is_ground]
    return ground[cKDTree(ground[:, :2]).query(xy)[1], 2]
