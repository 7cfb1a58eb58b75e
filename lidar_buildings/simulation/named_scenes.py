"""The scenes that can be asked for by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.simulation import roof_shapes as shapes
from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.facades import furnished
from lidar_buildings.simulation.scene import Road, Site, Terrain, VirtualScene, Wave
from lidar_buildings.simulation.street import street_canyon

#: The lots lie 5 by 5, this far apart, the first this far from the edges [m].
PITCH, FIRST = 52.0, 36.0
SIZE = 280.0
#: Of the ground of a village [m].
WAVES = (Wave(1.2, 130.0, 35.0, 0.4), Wave(0.3, 41.0, 110.0, 1.7))
#: A row of houses stands where its lot holds several.
Lot = Building | list[Building]


def village(seed: int, slope: tuple[float, float] = (0.035, 0.02)) -> VirtualScene:
    """
    Return 28 buildings of every roof shape, trees, walls, cars and two roads, 280 m square.

    The ground rises by a slope along x and y, 4 % if not given, with waves of 0.3 and 1.2 m. Which building
    stands on which lot, its size, place and orientation depend on the seed.
    """
    return _villages("village", 1, Terrain(120.0, slope, WAVES), seed)


def city(seed: int) -> VirtualScene:
    """
    Return 8 by 8 villages side by side, 1792 buildings on 5 km², for surveys that last.

    The ground rises by 1 % with waves of 0.3 to 3 m.
    """
    return _villages("city", 8, Terrain(120.0, (0.008, 0.005), (Wave(3.0, 700.0, 60.0, 1.1), *WAVES)), seed)


def _villages(name: str, side: int, terrain: Terrain, seed: int) -> VirtualScene:
    """So many villages along either side of a square, with roads through all of them."""
    extent = side * SIZE
    site = Site((extent, extent), terrain, seed)
    corners = [number * SIZE for number in range(side)]
    for corner in corners:
        y, x = corner + FIRST + 1.5 * PITCH, corner + FIRST + 2.5 * PITCH
        site.roads += [Road((0.0, y), (extent, y), 6.0), Road((x, 0.0), (x, extent), 7.0)]
    for x, y in product(corners, corners):
        _settle(site, x, y)
    site.add_cars(14 * side**2)
    site.add_trees(60 * side**2, clearance=1.0)
    return site.scene(name)


def _settle(site: Site, left: float, bottom: float) -> None:
    """Build on the 25 lots of a village, plant trees over three eaves and stand walls in the gardens."""
    lots = _lots(site.random)
    first = len(site.buildings)
    for lot, place in zip(lots, site.random.permutation(25), strict=True):
        x, y = left + FIRST + PITCH * (place % 5), bottom + FIRST + PITCH * (place // 5)
        turn = site.random.uniform(0, 360)
        if isinstance(lot, list):
            site.add_row(lot, x, y, turn)
        else:
            dx, dy = site.random.uniform(-1.5, 1.5, 2)
            site.add_building(lot, x + dx, y + dy, turn)
    for number in (1, 3, 7):
        site.add_tree_over_eave(first + number)
    for place in (3, 11, 17, 22):
        x, y = left + FIRST + PITCH * (place % 5), bottom + FIRST + PITCH * (place // 5) + 22.0
        site.add_wall(x, y, site.random.uniform(-8, 8))


def _lots(random: np.random.Generator) -> list[Lot]:
    """What stands on the 25 lots: 23 single buildings, a pair and a row of three houses."""

    def about(value: float) -> float:
        """Vary a measure by up to a tenth, to the decimetre."""
        return round(float(value * random.uniform(0.9, 1.1)), 1)

    gables = [shapes.gable(about(13), about(9), about(4.5), about(pitch)) for pitch in (25, 32, 38, 45)]
    hips = [shapes.hip(about(15), about(10), about(5), pitch_deg=about(pitch)) for pitch in (25, 35)]
    pyramid = shapes.hip(11, 11, about(5), pitch_deg=about(30))
    halls = [shapes.flat(about(16), about(11), about(6)), shapes.flat(about(30), about(18), about(8))]
    sheds = [shapes.shed(about(12), about(8), about(3.5), pitch) for pitch in (8, 18)]
    winged = [
        shapes.l_shape(about(16)),
        shapes.l_shape(about(18), wing_length=about(8)),
        shapes.l_shape(pitch_deg=0),
    ]
    tees = [shapes.t_shape(about(18)), shapes.t_shape(about(20), wing_length=about(8), pitch_deg=about(30))]
    courts = [shapes.courtyard(about(30)), shapes.courtyard(28, 24, 7, about(6), 28)]
    towers = [shapes.round_tower(about(12), about(13)), shapes.round_tower(about(13), about(7), 35)]
    steps = [shapes.step(about(18)), shapes.step(about(20), step_height=2.8, share=0.35)]
    row = [shapes.gable(9, 10, eave, 38) for eave in (5.0, 6.2, 8.0)]
    pair = [shapes.gable(8, 11, 5.5, 35), shapes.flat(8, 11, 9.0)]
    single = [*gables, *hips, pyramid, *halls, *sheds, *winged, *tees, *courts, *towers, *steps]
    return [*single, shapes.dormer(about(16)), row, pair]


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
    return _in_rows("roof_types", (200.0, 160.0), kinds, 20, seed)


def special_roofs(seed: int) -> VirtualScene:
    """Return one building of every special roof shape in rows on flat ground, turned at random."""
    kinds = [
        *(shapes.half_hip(), shapes.pyramid(), shapes.gambrel(), shapes.mansard()),
        *(shapes.cross_gable(), shapes.hipped_l(), shapes.double_gable(), shapes.gable_dormer()),
        *(shapes.sawtooth(), shapes.barrel(), shapes.church(), shapes.parapet()),
    ]
    return _in_rows("special_roofs", (200.0, 130.0), kinds, 25, seed)


def _in_rows(
    name: str, size: tuple[float, float], kinds: list[Building], first: int, seed: int
) -> VirtualScene:
    site = Site(size, Terrain(50.0), seed)
    for row, kind in enumerate(kinds):
        site.add_building(kind, 25 + 50 * (row % 4), first + 40 * (row // 4), site.random.uniform(0, 360))
    return site.scene(name)


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
    site.roads.append(Road((0.0, 45.0), (120.0, 45.0), 9.0))
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


#: Details have random numbers of their own, so that scenes do not change by them.
DETAILS = 1

#: Name → function of the seed.
SCENES: dict[str, Callable[[int], VirtualScene]] = {
    make.__name__: make
    for make in (
        *(village, single_house, roof_types, special_roofs),
        *(courtyards, flat_terrain_empty, dense_block, city, street_canyon),
    )
}


def make_scene(name: str, seed: int = 0, *, details: bool = False) -> VirtualScene:
    """
    Return the scene of this name; the same seed gives the same scene.

    With details, the roofs, which stay where they are, hang over the walls by 0.1 to 0.8 m, and the walls
    have windows and doors; in scene ``street_canyon`` they always do. ParameterError if there is no such
    scene, or the seed is negative.
    """
    if name not in SCENES:
        raise ParameterError(f"scene = {name!r}: must be one of {', '.join(SCENES)}")
    if seed < 0:
        raise ParameterError(f"seed = {seed}: must be at least 0")
    scene = SCENES[name](seed)
    if not details or scene.is_detailed:
        return scene
    buildings = furnished(list(scene.buildings), scene.streets(), np.random.default_rng([seed, DETAILS]))
    return replace(scene, buildings=tuple(buildings), is_detailed=True)
