"""
Virtual roofs with exact truth for plane fitting and building models, and input that is hard or bad.

Each function takes `density` [pts/m²], `noise` (σ along z) [m], `rotation_deg` and `seed`. Points are those
of the roof alone, in rows along x, one somewhere in every square of 1/density.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.scenes.kit import scan_rows
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.evaluation.scores.models import Wireframe, roof_wireframe
from lidar_buildings.simulation import roof_shapes as shapes
from lidar_buildings.simulation.building import Building, building_of, face_over, shell_of

#: Where the buildings stand [m] and elevation of the ground there [m].
CENTRE, GROUND = (40.0, 30.0), 10.0
#: Faces are noded to this [m]; vertices nearer than that are one.
_SAME_VERTEX = 1e-4


@dataclass(frozen=True, eq=False)
class ModelScene:
    """A building's roof points and what is true of it."""

    name: str
    points: NDArray[np.float64]  #: map frame [m], shape (n, 3)
    plane_id: NDArray[np.uint16]  #: the face that each point lies on, from 1; 0 = none. Shape (n,).
    building: Building  #: its faces with their planes, and its outline
    outline: Outline  #: what a stage is given: the true one unless the scene is about a bad one
    ground_elevation: float | None = GROUND  #: what a stage is told; None where no ground is known [m]
    #: Planes that the model is to be built from, where it is not to fit its own, shape (n,).
    given_planes: NDArray[np.uint16] | None = None

    @cached_property
    def solid(self) -> Solid:
        """The exact LoD2.2 solid."""
        return solid_of(self.building)

    @property
    def volume(self) -> float:
        """Of the exact solid [m³]."""
        return self.solid.volume

    @cached_property
    def wireframe(self) -> Wireframe:
        """Corners, edges and ridges of the exact roof."""
        return roof_wireframe([self.solid])

    @property
    def ridges(self) -> NDArray[np.float64]:
        """Ends of the level ridges, shape (n_ridges, 2, 3) [m]."""
        return self.wireframe.segments[self.wireframe.is_ridge]

    @property
    def normals(self) -> NDArray[np.float64]:
        """Upward unit normal of each face, shape (n_faces, 3)."""
        return np.array([face.normal for face in self.building.faces])

    def select(self, rows: NDArray) -> ModelScene:
        """Return the scene with only these points, by mask or indices; for scenes without given planes."""
        return replace(self, points=self.points[rows], plane_id=self.plane_id[rows])


def solid_of(building: Building) -> Solid:
    """Return a virtual building's exact solid."""
    shell = shell_of(building)
    rows: dict[tuple[float, ...], int] = {}
    faces = tuple(
        tuple(
            tuple(rows.setdefault(tuple(v), len(rows)) for v in np.round(ring / _SAME_VERTEX).tolist())
            for ring in surface
        )
        for surface in shell.surfaces
    )
    kinds = ("RoofSurface",) * len(shell.roofs) + ("WallSurface",) * len(shell.walls) + ("GroundSurface",)
    return Solid(np.array(list(rows)) * _SAME_VERTEX, faces, kinds)


def scene_of(
    name: str, shape: Building, *, density=8.0, noise=0.03, rotation_deg=0.0, seed=0, centre=CENTRE
) -> ModelScene:
    """Put a shape on its ground and sample its roof."""
    random = np.random.default_rng(seed)
    building = shape.placed(0, 0, rotation_deg).placed(*centre, elevation=GROUND)
    low, high = building.exterior.min(axis=0), building.exterior.max(axis=0)
    xy = scan_rows(low, high, density, random)
    plane_id, z = building.roof_at(xy)
    on = plane_id > 0
    points = np.column_stack([xy, z + random.normal(0, noise, len(xy))])[on]
    return ModelScene(name, points, plane_id[on], building, building.outline)


#: Name → a shape of the roof that it is about; names are those of `roof_type` where there is one.
SHAPES: dict[str, Callable[[], Building]] = {
    "flat": shapes.flat,
    "shed": shapes.shed,
    "gable": shapes.gable,
    "low_gable": partial(shapes.gable, pitch_deg=12.0),
    "hip": shapes.hip,
    "half_hip": shapes.half_hip,
    "pyramid": shapes.pyramid,
    "l_shape": shapes.l_shape,
    "t_shape": shapes.t_shape,
    "hipped_l": shapes.hipped_l,
    "cross_gable": shapes.cross_gable,
    "double_gable": shapes.double_gable,
    "step": shapes.step,
    "dormer": shapes.dormer,
    "gable_dormer": shapes.gable_dormer,
    "courtyard": shapes.courtyard,
    "pitched_courtyard": partial(shapes.courtyard, pitch_deg=30.0),
    "gambrel": shapes.gambrel,
    "mansard": shapes.mansard,
    "sawtooth": shapes.sawtooth,
    "barrel": shapes.barrel,
    "round_tower": shapes.round_tower,
    "pointed_tower": partial(shapes.round_tower, diameter=14.0, eave=7.0, pitch_deg=40.0, n_sides=24),
    "church": shapes.church,
    "parapet": shapes.parapet,
}

#: Shape → words for its roof that are right.
ROOF_WORDS: dict[str, tuple[str, ...]] = {
    "low_gable": ("gable",),
    "half_hip": ("half-hip", "half_hip"),
    "l_shape": ("L", "l", "l-shape", "l_shape"),
    "t_shape": ("T", "t", "t-shape", "t_shape"),
    "hipped_l": ("L", "l", "l-shape", "l_shape", "complex"),
    "cross_gable": ("complex", "cross-gable", "cross_gable", "T", "t"),
    "step": ("flat", "complex", "step"),
    "dormer": ("gable", "complex", "dormer"),
    "gable_dormer": ("gable", "complex", "dormer"),
    "church": ("gable", "complex", "church"),
    "courtyard": ("flat",),
    "round_tower": ("flat",),
    "pointed_tower": ("pyramid", "complex"),
    "parapet": ("flat", "complex"),
}
_COMPLEX = {"double_gable", "pitched_courtyard", "gambrel", "mansard", "sawtooth", "barrel"}


def roof_words(name: str) -> tuple[str, ...]:
    """Return the words for a shape's roof that are right."""
    return ROOF_WORDS.get(name, ("complex",) if name in _COMPLEX else (name,))


def model_scene(name: str, **sampling) -> ModelScene:
    """Return the scene of one of `SHAPES`."""
    return scene_of(name, SHAPES[name](), **sampling)


def small_plane(**sampling) -> ModelScene:
    """
    A flat roof with a lift housing of 0.7 × 0.6 m, on which a point or two lie for each of eight per m².
    """
    house = shapes.flat()
    box = shapely.box(1.0, 1.0, 1.7, 1.6)
    (roof,) = house.faces
    faces = face_over(roof.polygon - box, roof.plane), face_over(box, (0.0, 0.0, roof.plane[2] + 1.5))
    return scene_of("small_plane", building_of("small_plane", faces), **sampling)


def half_missing(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> ModelScene:
    """A gable house with no point on the eastern half of its length."""
    scene = model_scene("gable", density=density, noise=noise, rotation_deg=rotation_deg, seed=seed)
    east = np.array([np.cos(np.deg2rad(rotation_deg)), np.sin(np.deg2rad(rotation_deg))])
    return replace(scene.select((scene.points[:, :2] - CENTRE) @ east < 0), name="half_missing")


def one_face_missing(**sampling) -> ModelScene:
    """A gable house of which one of the two faces has no point."""
    scene = model_scene("gable", **sampling)
    return replace(scene.select(scene.plane_id == 1), name="one_face_missing")


def no_ground(**sampling) -> ModelScene:
    """A hip house of which no ground is known."""
    scene = model_scene("hip", **sampling)
    return replace(scene, name="no_ground", ground_elevation=None)


def ground_above_eaves(**sampling) -> ModelScene:
    """A gable house dug into a slope: the ground given lies between eave and ridge."""
    scene = model_scene("gable", **sampling)
    low, high = scene.building.roof_elevation_range
    return replace(scene, name="ground_above_eaves", ground_elevation=(low + high) / 2)


def tree_grown_in(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> ModelScene:
    """
    A gable house with a crown of 2.5 m radius on its south-eastern corner, whose points are taken for roof.
    """
    scene = model_scene("gable", density=density, noise=noise, rotation_deg=rotation_deg, seed=seed)
    corner = scene.building.exterior[np.argmax(scene.building.exterior @ (1.0, -1.0))]
    random = np.random.default_rng(seed + 1)
    direction = random.normal(size=(int(3 * density * np.pi * 2.5**2), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    crown = (*corner, GROUND + 6.5) + direction * random.random((len(direction), 1)) ** (1 / 3) * 2.5
    inside = shapely.contains_xy(scene.building.polygon, crown[:, 0], crown[:, 1])
    return replace(
        scene,
        name="tree_grown_in",
        points=np.vstack([scene.points, crown[inside]]),
        plane_id=np.append(scene.plane_id, np.zeros(inside.sum(), dtype=np.uint16)),
    )


def upright_plane(**sampling) -> ModelScene:
    """A gambrel roof whose lower faces rise at 86°, 0.25 m wide in plan."""
    return scene_of("upright_plane", shapes.gambrel(lower_pitch_deg=86.0, break_width=0.25), **sampling)


def coincident_planes(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> ModelScene:
    """A flat roof whose points are shared out at random between ten planes that are the same."""
    scene = model_scene("flat", density=density, noise=noise, rotation_deg=rotation_deg, seed=seed)
    ids = 1 + np.random.default_rng(seed + 1).integers(0, 10, len(scene.points))
    return replace(scene, name="coincident_planes", given_planes=ids.astype(np.uint16))


def touching_courtyard(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> ModelScene:
    """A flat house whose outline has a courtyard that touches the outer ring with one corner."""
    scene = model_scene("flat", density=density, noise=noise, rotation_deg=rotation_deg, seed=seed)
    angle = np.deg2rad(rotation_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    yard = np.array([(0.0, -5.0), (-2.0, -1.0), (0.0, 1.0), (2.0, -1.0)]) @ turn + CENTRE
    free = ~shapely.contains_xy(shapely.Polygon(yard), scene.points[:, :2])
    outline = Outline(scene.outline.exterior, (yard,))
    return replace(scene.select(free), name="touching_courtyard", outline=outline)


def narrow_parapet(*, density=8.0, **sampling) -> ModelScene:
    """A flat roof behind a parapet that is two points wide."""
    shape = shapes.parapet(rim=2 / float(np.sqrt(density)), rim_height=0.9)
    return scene_of("narrow_parapet", shape, density=density, **sampling)


#: Name → function, all input that is hard or bad.
BAD_SCENES: dict[str, Callable[..., ModelScene]] = {
    "small_plane": small_plane,
    "half_missing": half_missing,
    "one_face_missing": one_face_missing,
    "no_ground": no_ground,
    "ground_above_eaves": ground_above_eaves,
    "tree_grown_in": tree_grown_in,
    "upright_plane": upright_plane,
    "coincident_planes": coincident_planes,
    "touching_courtyard": touching_courtyard,
    "barrel": partial(model_scene, "barrel"),
    "narrow_parapet": narrow_parapet,
    "church": partial(model_scene, "church"),
}
