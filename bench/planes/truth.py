"""Roofs whose planes are known: real ones labelled by hand, and virtual ones whose planes are exact."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray

from bench.scenes.kit import functions_of, scan_rows
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.evaluation.scores.planes import PART_GAP, planes_of_colours
from lidar_buildings.simulation import roof_shapes
from lidar_buildings.simulation.building import Building

#: Roofs of points alone, coloured by plane.
LABELLED = "trondheim"


class KnownRoof(NamedTuple):
    """The points of a roof and their planes."""

    name: str
    points: NDArray[np.float64]  #: near the origin [m], shape (n_points, 3)
    planes: NDArray[np.int64]  #: from 1; −1 for points that do not count. Shape (n_points,).
    #: Of the planes by their numbers; empty where they are not known. Shape (n_planes, 3).
    normals: NDArray[np.float64]


def labelled_roofs(data: Path) -> list[KnownRoof]:
    """Read the roofs that were coloured by hand, one file each."""
    return [_labelled_roof(path) for path in sorted((data / LABELLED).glob("*.laz"))]


def _labelled_roof(path: Path) -> KnownRoof:
    """Read a roof; each connected part of a colour is a plane."""
    las = laspy.read(path)
    points = np.column_stack([las.x, las.y, las.z])
    points -= np.floor(points.min(axis=0))
    channels = np.column_stack([las.red, las.green, las.blue]).astype(np.int64)
    colour = np.unique(channels, axis=0, return_inverse=True)[1].reshape(-1)
    planes = planes_of_colours(points, np.where(channels.any(axis=1), colour, -1))
    return KnownRoof(path.stem, points, planes, np.empty((0, 3)))


def shapes() -> dict[str, Building]:
    """Return every roof shape of the simulation with its defaults, by name."""
    found = functions_of(roof_shapes).items()
    return {name: shape() for name, shape in found if shape.__annotations__["return"] == "Building"}


def virtual_roof(name: str, building: Building, density: float, noise: float, seed: int) -> KnownRoof:
    """Sample a building's roof, turned by some angle, one point somewhere in every square of 1 / density."""
    random = np.random.default_rng(seed)
    placed = building.placed(30.0, 30.0, rotation_deg=17.0 + 40.0 * seed, elevation=5.0)
    number_of, normals = planes_of_faces(placed)
    low, high = placed.exterior.min(axis=0), placed.exterior.max(axis=0)
    xy = scan_rows(low, high, density, random)
    planes, z = placed.roof_at(xy)
    inside = planes > 0
    z = z + random.normal(0.0, noise, len(z))
    return KnownRoof(name, np.column_stack([xy, z])[inside], number_of[planes[inside]], normals)


def planes_of_faces(building: Building) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """
    Return the number of the plane that each face number is part of, and the planes' normals.

    Faces of one plane that touch, if only at a corner, are one plane.
    """
    faces = building.faces
    touches = [
        (i, j)
        for i, j in itertools.combinations(range(len(faces)), 2)
        if np.allclose(faces[i].plane, faces[j].plane, atol=1e-6)
        and faces[i].polygon.distance(faces[j].polygon) < PART_GAP
    ]
    one, other = np.array(touches, dtype=np.int64).reshape(-1, 2).T
    first, number = np.unique(sets_of_pairs(len(faces), one, other), return_inverse=True)
    return np.append(0, number.reshape(-1) + 1), np.array([faces[k].normal for k in first])


def virtual_roofs(densities: Sequence[float], noises: Sequence[float], n_seeds: int) -> list[KnownRoof]:
    """Sample every shape with every density [points/m²] and noise [m]."""
    return [
        virtual_roof(name, building, density, noise, seed)
        for name, building in shapes().items()
        for density in densities
        for noise in noises
        for seed in range(n_seeds)
    ]
