"""
Small scenes with their truth: every edge case that a stage has to stand.

Each function takes `density` [pts/m²], `noise` (σ along z) [m], `rotation_deg` (of all buildings about the
scene's centre) and `seed`. Points come in scan order (rows along x), one return per pulse, no façades.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.scenes.kit import scan_rows
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


def sampled(
    shapes: Sequence[Building],
    *,
    density: float = 8.0,
    noise: float = 0.03,
    rotation_deg: float = 0.0,
    seed: int = 0,
    slope: tuple[float, float] = (0.0, 0.0),
) -> Scene:
    """Put shapes into the scene's middle and sample roofs and ground; it may rise along x and y."""
    random = np.random.default_rng(seed)
    buildings = tuple(
        replace(shape.placed(0, 0, rotation_deg).placed(*CENTRE, elevation=GROUND), number=number)
        for number, shape in enumerate(shapes, start=1)
    )
    corners = np.concatenate([building.exterior for building in buildings])
    low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
    xy = scan_rows(low, high, density, random)
    z = GROUND + (xy - CENTRE) @ slope
    roof_plane = np.zeros(len(xy), dtype=np.uint16)
    number = np.zeros(len(xy), dtype=np.uint32)
    for building in buildings:
        plane_id, roof = building.roof_at(xy)
        rows = (plane_id > 0) & (number == 0)
        z[rows], roof_plane[rows], number[rows] = roof[rows], plane_id[rows], building.number
    points = np.column_stack([xy, z + random.normal(0, noise, len(xy))])
    return Scene(points, number == 0, number > 0, buildings, roof_plane, number)


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


flat = partial(sampled, [roof_shapes.flat()])
shed = partial(sampled, [roof_shapes.shed()])
gable = partial(sampled, [roof_shapes.gable()])
hip = partial(sampled, [roof_shapes.hip()])
l_shape = partial(sampled, [roof_shapes.l_shape()])
t_shape = partial(sampled, [roof_shapes.t_shape()])
step_roof = partial(sampled, [roof_shapes.step()])
dormer = partial(sampled, [roof_shapes.dormer()])
courtyard = partial(sampled, [roof_shapes.courtyard()])
round_tower = partial(sampled, [roof_shapes.round_tower()])
#: A hip house on ground that rises by 25 % towards the north-east.
house_on_slope = partial(sampled, [roof_shapes.hip()], slope=(0.2, 0.15))


def touching_houses(**sampling: Any) -> Scene:
    """Two gable houses of one row; the eastern one is 2.5 m higher."""
    west = roof_shapes.gable(length=9, width=10, eave=5).placed(-4.5, 0)
    east = roof_shapes.gable(length=9, width=10, eave=7.5).placed(4.5, 0)
    return sampled([west, east], **sampling)


def tree_over_eave(*, density: float = 8.0, seed: int = 0, **sampling: Any) -> Scene:
    """A gable house whose south-eastern corner stands under a tree as high as its ridge."""
    house = gable(density=density, seed=seed, **sampling)
    corner = house.buildings[0].exterior[np.argmax(house.buildings[0].exterior @ (1.0, -1.0))]
    return _with_crown(house, (*corner, GROUND + 6.0), (3.0, 3.0, 2.5), density, seed)


def sparse(*, density: float = 8.0, **sampling: Any) -> Scene:
    """A large gable house at a sixteenth of the density: 0.5 pts/m² by default."""
    return sampled([roof_shapes.gable(length=24, width=14)], density=density / 16, **sampling)


def single_point(**sampling: Any) -> Scene:
    scene = flat(**sampling)
    return scene.select(np.flatnonzero(scene.is_roof)[:1])


def collinear(*, density: float = 8.0, rotation_deg: float = 0.0, **sampling: Any) -> Scene:
    """Roof points exactly on one line, twenty of them or as many as the density gives 14 m of scan line."""
    scene = flat(density=density, rotation_deg=rotation_deg, **sampling)
    chosen = scene.select(np.flatnonzero(scene.is_roof)[: max(20, int(14 * density**0.5))])
    step = (np.arange(len(chosen.points)) - len(chosen.points) / 2) / density**0.5
    direction = np.array([np.cos(np.deg2rad(rotation_deg)), np.sin(np.deg2rad(rotation_deg)), 0.0])
    return replace(chosen, points=np.array([*CENTRE, GROUND + 6.0]) + step[:, None] * direction)


def duplicates(**sampling: Any) -> Scene:
    """A gable house, every point there twice."""
    scene = gable(**sampling)
    return scene.select(np.repeat(np.arange(len(scene.points)), 2))


def with_nan(**sampling: Any) -> Scene:
    """A gable house, one coordinate of every hundredth point not a number."""
    scene = gable(**sampling)
    points = scene.points.copy()
    rows = np.arange(0, len(points), 100)
    points[rows, np.arange(len(rows)) % 3] = np.nan
    return replace(scene, points=points)


#: Name → function, every scene above.
GALLERY: dict[str, Callable[..., Scene]] = {
    "flat": flat,
    "shed": shed,
    "gable": gable,
    "hip": hip,
    "l_shape": l_shape,
    "t_shape": t_shape,
    "touching_houses": touching_houses,
    "step_roof": step_roof,
    "dormer": dormer,
    "courtyard": courtyard,
    "round_tower": round_tower,
    "house_on_slope": house_on_slope,
    "tree_over_eave": tree_over_eave,
    "sparse": sparse,
    "single_point": single_point,
    "collinear": collinear,
    "duplicates": duplicates,
    "with_nan": with_nan,
}
