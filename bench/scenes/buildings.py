"""
Small scenes with their truth: every edge case that a stage has to stand.

Each function takes `density` [pts/m²], `noise` (σ along z) [m], `rotation_deg` (of all buildings about the
scene's centre) and `seed`. Points come in scan order (rows along x), one return per pulse, no façades.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.simulation import roof_shapes
from lidar_buildings.simulation.building import Building

#: Middle of every scene [m] and elevation of its flat ground [m].
CENTRE = np.array([40.0, 30.0])
GROUND = 10.0
#: Ground around the buildings [m].
MARGIN = 10.0


@dataclass(frozen=True, eq=False)
class Scene:
    """Points and what is true of them."""

    points: NDArray[np.float64]  #: coordinates [m], shape (n, 3)
    #: A tree's points are neither, shape (n,).
    is_ground: NDArray[np.bool_]
    is_roof: NDArray[np.bool_]
    #: Each with `exterior` (counter-clockwise, open), `holes`, `faces`, `planes` (a, b, c of z = a·x + b·y +
    #: c), `outline`, `polygon`, `ground_elevation`, `roof_elevation_range`, `height`, `number` (from 1).
    buildings: tuple[Building, ...]
    #: Plane id within the building (face i has id i + 1), 0 = none, shape (n,).
    roof_plane: NDArray[np.uint16]
    building: NDArray[np.uint32]  #: number of the building, 0 = none, shape (n,)

    def select(self, rows: NDArray) -> Scene:
        """Return the scene with only these rows, by mask or indices."""
        names = ("points", "is_ground", "is_roof", "roof_plane", "building")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def roof_points(self, number: int = 1) -> NDArray[np.float64]:
        """Return the roof points of one building."""
        return self.points[self.is_roof & (self.building == number)]


def flat(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.flat()], density, noise, rotation_deg, seed)


def shed(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.shed()], density, noise, rotation_deg, seed)


def gable(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.gable()], density, noise, rotation_deg, seed)


def hip(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.hip()], density, noise, rotation_deg, seed)


def l_shape(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.l_shape()], density, noise, rotation_deg, seed)


def t_shape(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.t_shape()], density, noise, rotation_deg, seed)


def touching_houses(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    """Two gable houses of one row; the eastern one is 2.5 m higher."""
    west = roof_shapes.gable(length=9, width=10, eave=5).placed(-4.5, 0)
    east = roof_shapes.gable(length=9, width=10, eave=7.5).placed(4.5, 0)
    return _sampled([west, east], density, noise, rotation_deg, seed)


def step_roof(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.step()], density, noise, rotation_deg, seed)


def dormer(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.dormer()], density, noise, rotation_deg, seed)


def courtyard(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.courtyard()], density, noise, rotation_deg, seed)


def round_tower(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    return _sampled([roof_shapes.round_tower()], density, noise, rotation_deg, seed)


def house_on_slope(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    """A hip house on ground that rises by 25 % towards the north-east."""
    return _sampled([roof_shapes.hip()], density, noise, rotation_deg, seed, slope=(0.2, 0.15))


def tree_over_eave(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    """A gable house whose south-eastern corner stands under a tree as high as its ridge."""
    house = _sampled([roof_shapes.gable()], density, noise, rotation_deg, seed)
    corner = house.buildings[0].exterior[np.argmax(house.buildings[0].exterior @ (1.0, -1.0))]
    return _with_crown(house, (*corner, GROUND + 6.0), (3.0, 3.0, 2.5), density, seed)


def sparse(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    """A large gable house at a sixteenth of the density: 0.5 pts/m² by default."""
    return _sampled([roof_shapes.gable(length=24, width=14)], density / 16, noise, rotation_deg, seed)


def single_point(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    scene = flat(density=density, noise=noise, rotation_deg=rotation_deg, seed=seed)
    return scene.select(np.flatnonzero(scene.is_roof)[:1])


def collinear(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    """Roof points exactly on one line, twenty of them or as many as the density gives 14 m of scan line."""
    scene = flat(density=density, noise=noise, rotation_deg=rotation_deg, seed=seed)
    chosen = scene.select(np.flatnonzero(scene.is_roof)[: max(20, int(14 * density**0.5))])
    step = (np.arange(len(chosen.points)) - len(chosen.points) / 2) / density**0.5
    direction = np.array([np.cos(np.deg2rad(rotation_deg)), np.sin(np.deg2rad(rotation_deg)), 0.0])
    return replace(chosen, points=np.array([*CENTRE, GROUND + 6.0]) + step[:, None] * direction)


def duplicates(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    """A gable house, every point there twice."""
    scene = gable(density=density, noise=noise, rotation_deg=rotation_deg, seed=seed)
    return scene.select(np.repeat(np.arange(len(scene.points)), 2))


def with_nan(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> Scene:
    """A gable house, one coordinate of every hundredth point not a number."""
    scene = gable(density=density, noise=noise, rotation_deg=rotation_deg, seed=seed)
    points = scene.points.copy()
    rows = np.arange(0, len(points), 100)
    points[rows, np.arange(len(rows)) % 3] = np.nan
    return replace(scene, points=points)


#: Name → function, every scene above.
GALLERY: dict[str, Callable[..., Scene]] = {
    scene.__name__: scene
    for scene in (
        flat,
        shed,
        gable,
        hip,
        l_shape,
        t_shape,
        touching_houses,
        step_roof,
        dormer,
        courtyard,
        round_tower,
        house_on_slope,
        tree_over_eave,
        sparse,
        single_point,
        collinear,
        duplicates,
        with_nan,
    )
}


def _sampled(
    shapes: Sequence[Building],
    density: float,
    noise: float,
    rotation_deg: float,
    seed: int,
    slope: tuple[float, float] = (0.0, 0.0),
) -> Scene:
    """Put the shapes into the scene's middle and sample roofs and ground."""
    random = np.random.default_rng(seed)
    buildings = tuple(
        replace(shape.placed(0, 0, rotation_deg).placed(*CENTRE, elevation=GROUND), number=number)
        for number, shape in enumerate(shapes, start=1)
    )
    xy = _scan_rows(buildings, density, random)
    z = GROUND + (xy - CENTRE) @ slope
    roof_plane = np.zeros(len(xy), dtype=np.uint16)
    number = np.zeros(len(xy), dtype=np.uint32)
    for building in buildings:
        plane_id, roof = building.roof_at(xy)
        rows = (plane_id > 0) & (number == 0)
        z[rows], roof_plane[rows], number[rows] = roof[rows], plane_id[rows], building.number
    points = np.column_stack([xy, z + random.normal(0, noise, len(xy))])
    return Scene(points, number == 0, number > 0, buildings, roof_plane, number)


def _scan_rows(
    buildings: tuple[Building, ...], density: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Positions in rows along x around the buildings, one somewhere in every square of 1/density."""
    corners = np.concatenate([building.exterior for building in buildings])
    low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
    spacing = 1 / np.sqrt(density)
    columns, rows = np.ceil((high - low) / spacing).astype(int)
    cell = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    return low + (cell + random.random(cell.shape)) * spacing


def _with_crown(
    scene: Scene, middle: tuple[float, ...], radii: tuple[float, ...], density: float, seed: int
) -> Scene:
    """Append the points of a tree's crown: an ellipsoid, three returns where there is one point of ground."""
    random = np.random.default_rng(seed + 1)
    n_points = int(3 * density * np.pi * radii[0] * radii[1])
    direction = random.normal(size=(n_points, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    crown = np.asarray(middle) + direction * random.random((n_points, 1)) ** (1 / 3) * radii
    nothing = np.zeros(n_points, dtype=np.uint16)
    return replace(
        scene,
        points=np.vstack([scene.points, crown]),
        is_ground=np.append(scene.is_ground, nothing > 0),
        is_roof=np.append(scene.is_roof, nothing > 0),
        roof_plane=np.append(scene.roof_plane, nothing),
        building=np.append(scene.building, nothing.astype(np.uint32)),
    )
