"""Bridges: ground that lies between two opposite drops is a deck, not terrain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.surfaces.tin import Tin

# Chosen with `bench.ground.scenes` and the bridges of the tests.
#: A side of the mesh is a drop if it falls by this much, and by this much over its length [m].
MIN_DROP, MIN_DROP_SLOPE = 3.0, 3.0
#: Longest drop, in spacings of the candidates: over a longer one there may be a slope.
MAX_DROP_LENGTH = 4.0
#: Widest deck [m].
MAX_WIDTH = 30.0
#: Two edges belong together if they look away from each other: largest cosine of the angle between them, and
#: least cosine between each and the line that joins them.
MAX_OPPOSITION, MIN_ALIGNMENT = -0.85, 0.85
#: How much higher one edge may be: so much over the width, and this much at all [m].
MAX_CROSSFALL, LEVEL_TOLERANCE = 0.12, 0.5
#: How far from the line between the edges the deck's points may be [m].
DECK_TOLERANCE = 0.75


def find_decks(terrain: Tin, candidates: NDArray[np.float64], spacing: float) -> NDArray[np.bool_]:
    """
    Tell which candidates lie on decks: between two edges that drop to the terrain on opposite sides.

    Growth climbs a bridge along its approach. Across it, the ground falls off in a step on both sides, which
    an embankment with its slopes does not, nor a terrace, which falls off on one. (`roof_selection` looks at
    what never became ground, elevated surfaces of points, and at their ends instead of their sides.)

    Candidates and their spacing are those of `find_landforms`.
    """
    decks = np.zeros(len(candidates), dtype=np.bool_)
    edges, outward = _deck_edges(terrain, spacing)
    first, second = _opposite(edges, outward)
    if len(first) == 0:
        return decks
    across = _along(edges[first], edges[second], spacing)
    distance, nearest = cKDTree(candidates[:, :2]).query(across[:, :2], 2, distance_upper_bound=spacing)
    for rows, away in zip(nearest.T, distance.T, strict=True):
        found = np.flatnonzero(np.isfinite(away))
        level = np.abs(candidates[rows[found], 2] - across[found, 2]) <= DECK_TOLERANCE
        decks[rows[found[level]]] = True
    return decks


def _deck_edges(terrain: Tin, spacing: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the vertices above drops (n, 3) and the direction in which it falls off there (n, 2)."""
    top, step = _drops(terrain.vertices, terrain.triangles, MAX_DROP_LENGTH * spacing)
    vertices, place = np.unique(top, return_inverse=True)
    total = np.column_stack([np.bincount(place, step[:, axis], len(vertices)) for axis in range(2)])
    size = np.hypot(*total.T)
    clear = size > 0.0
    at = terrain.vertices[vertices[clear]] + [*terrain.origin, 0.0]
    return at, total[clear] / size[clear, None]


def _drops(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32], max_length: float
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """
    Return the upper ends of the sides that drop (n,), and the directions that they fall off in (n, 2).

    A side inside the mesh is a side of two triangles, once each way round: every drop is met once at least.
    """
    top = triangles.T.reshape(-1)
    foot = triangles.T[[1, 2, 0]].reshape(-1)
    high = np.flatnonzero(vertices[top, 2] - vertices[foot, 2] >= MIN_DROP)
    top, foot = top[high], foot[high]
    step = vertices[foot] - vertices[top]
    length = np.hypot(step[:, 0], step[:, 1])
    is_drop = (-step[:, 2] >= MIN_DROP_SLOPE * length) & (length > 0.0) & (length <= max_length)
    return top[is_drop], step[is_drop, :2] / length[is_drop, None]


def _opposite(
    edges: NDArray[np.float64], outward: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    pairs = (
        cKDTree(edges[:, :2]).query_pairs(MAX_WIDTH, output_type="ndarray")
        if len(edges)
        else np.zeros((0, 2), int)
    )
    first, second = pairs.T
    across = edges[second] - edges[first]
    width = np.maximum(np.hypot(across[:, 0], across[:, 1]), 1e-9)
    facing = (outward[first] * outward[second]).sum(axis=1) <= MAX_OPPOSITION
    facing &= (outward[second] * across[:, :2]).sum(axis=1) >= MIN_ALIGNMENT * width
    facing &= (outward[first] * across[:, :2]).sum(axis=1) <= -MIN_ALIGNMENT * width
    facing &= np.abs(across[:, 2]) <= MAX_CROSSFALL * width + LEVEL_TOLERANCE
    return first[facing], second[facing]


def _along(start: NDArray[np.float64], end: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return points along lines, ends included, half a step apart at most."""
    n_steps = np.ceil(2.0 * np.hypot(*(end - start)[:, :2].T) / step).astype(np.intp) + 1
    line = np.repeat(np.arange(len(start)), n_steps + 1)
    place = np.arange(len(line)) - np.repeat(np.cumsum(n_steps + 1) - (n_steps + 1), n_steps + 1)
    return start[line] + (end - start)[line] * (place / n_steps[line])[:, None]
