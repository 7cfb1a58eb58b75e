"""The scenes that can be asked for by name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.simulation import roof_shapes as shapes
from lidar_buildings.simulation import special_roofs as special
from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.scene import Road, VirtualScene
from lidar_buildings.simulation.site import Site
from lidar_buildings.simulation.terrain import Terrain, Wave
from lidar_buildings.simulation.village import city, village


def single_house(seed: int) -> VirtualScene:
    """Return a gable house with two trees on gently sloping ground, 60 m square."""
    site = Site((60.0, 60.0), Terrain(100.0, (0.02, 0.01)), seed)
    site.add_building(shapes.gable(16, 10), 30, 30, site.random.uniform(0, 180))
    site.add_trees(2, clearance=1.0)
    return site.scene("single_house")


def roof_types(seed: int) -> VirtualScene:
    """Return one building of every roof shape in rows on flat ground, turned at random."""
    kinds = [
        *(shapes.flat(), shapes.shed(), shapes.gable(), shapes.hip(), shapes.hip(length=10)),
        *(shapes.l_shape(), shapes.l_shape(pitch_deg=0), shapes.t_shape(), shapes.step(), shapes.dormer()),
        *(shapes.courtyard(), shapes.courtyard(pitch_deg=30)),
        *(shapes.round_tower(), shapes.round_tower(diameter=14, eave=7, pitch_deg=35)),
    ]
    site = Site((200.0, 160.0), Terrain(50.0), seed)
    for row, kind in enumerate(kinds):
        x, y = 25 + 50 * (row % 4), 20 + 40 * (row // 4)
        site.add_building(kind, x, y, site.random.uniform(0, 360))
    return site.scene("roof_types")


def special_roofs(seed: int) -> VirtualScene:
    """Return one building of every special roof shape in rows on flat ground, turned at random."""
    kinds = [
        *(special.half_hip(), special.pyramid(), special.gambrel(), special.mansard()),
        *(special.cross_gable(), special.hipped_l(), special.double_gable(), special.gable_dormer()),
        *(special.sawtooth(), special.barrel(), special.church(), special.parapet()),
    ]
    site = Site((200.0, 130.0), Terrain(50.0), seed)
    for row, kind in enumerate(kinds):
        site.add_building(kind, 25 + 50 * (row % 4), 25 + 40 * (row // 4), site.random.uniform(0, 360))
    return site.scene("special_roofs")


def courtyards(seed: int) -> VirtualScene:
    """Return four courtyard buildings with wide and narrow courts, flat and pitched, 120 m square."""
    site = Site((120.0, 120.0), Terrain(80.0, (0.01, 0.02), (Wave(0.5, 90.0, 30.0),)), seed)
    site.add_building(shapes.courtyard(), 30, 30, site.random.uniform(0, 90))
    site.add_building(shapes.courtyard(36, 30, 9, pitch_deg=30), 88, 30, site.random.uniform(0, 90))
    site.add_building(shapes.courtyard(32, 28, 11), 30, 88, site.random.uniform(0, 90))
    site.add_building(shapes.courtyard(30, 30, 6, pitch_deg=25), 88, 88, site.random.uniform(0, 90))
    return site.scene("courtyards")


def flat_terrain_empty(seed: int) -> VirtualScene:
    """Return a level field without anything on it, 100 m square."""
    return Site((100.0, 100.0), Terrain(20.0), seed).scene("flat_terrain_empty")


def dense_block(seed: int) -> VirtualScene:
    """Return two closed rows of touching town houses of different heights along a street, 120 × 90 m."""
    site = Site((120.0, 90.0), Terrain(30.0, (0.01, 0.0)), seed)
    site.add_road(Road((0.0, 45.0), (120.0, 45.0), 9.0))
    for y, turn in ((28.0, 0.0), (62.0, 180.0)):
        for row in range(8):
            site.add_building(_town_house(site.random), 60 + 10 * (row - 3.5), y, turn)
    site.add_cars(8)
    site.add_trees(10, clearance=1.5)
    return site.scene("dense_block")


def _town_house(random: np.random.Generator) -> Building:
    """A house 10 m wide with party walls on both sides: gable to the street, flat, or with a dormer."""
    eave = 6.0 + 1.5 * int(random.integers(0, 6))
    kinds = [shapes.gable, shapes.flat, shapes.dormer, shapes.shed]
    return kinds[random.integers(0, 4)](length=10, width=12, eave=eave)


#: Name → function of the seed.
SCENES: dict[str, Callable[[int], VirtualScene]] = {
    "village": village,
    "single_house": single_house,
    "roof_types": roof_types,
    "special_roofs": special_roofs,
    "courtyards": courtyards,
    "flat_terrain_empty": flat_terrain_empty,
    "dense_block": dense_block,
    "city": city,
}


def make_scene(name: str, seed: int = 0) -> VirtualScene:
    """
    Return the scene of this name; the same seed gives the same scene.

    Raises
    ------
    ParameterError
        If there is no such scene, or the seed is negative.
    """
    if name not in SCENES:
        raise ParameterError(f"scene = {name!r}: must be one of {', '.join(SCENES)}")
    if seed < 0:
        raise ParameterError(f"seed = {seed}: must be at least 0")
    return SCENES[name](seed)
