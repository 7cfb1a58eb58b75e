"""A street as a vehicle sees it: fronts on both sides, and what stands before them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from lidar_buildings.simulation import roof_shapes as shapes
from lidar_buildings.simulation.building import Building, Opening, building_of, face_over
from lidar_buildings.simulation.facades import furnished
from lidar_buildings.simulation.scene import Road, Site, Terrain, VirtualScene

#: Extent, and where the axis of the road runs, on which the vehicle drives [m].
LENGTH, WIDTH, AXIS = 160.0, 64.0, 32.0
#: Half width of the road, height of its kerbs, and from its axis to gardens' fences [m].
KERB_AT, KERB, FENCE_AT = 3.6, 0.12, 5.6
#: Fronts are at least and at most so far from the axis [m].
NEAREST, FARTHEST = 6.0, 12.0
#: What the parked vehicles' middles keep from the axis [m].
PARKED_AT = 2.55


def street_canyon(seed: int) -> VirtualScene:
    """
    Return a street of 160 m between two rows of houses, 6 to 12 m from its axis, with all that stands there.

    Town houses wall to wall, villas behind hedges, fences and garden walls, an arcade and a curved front on
    each side; parked cars and lorries, poles, trees and people. Kerbs are 12 cm high.
    """
    site = Site((LENGTH, WIDTH), Terrain(40.0, (0.015, 0.004)), seed)
    site.roads.append(Road((0.0, AXIS), (LENGTH, AXIS), 2 * KERB_AT))
    for side in (1, -1):
        _add_pavement(site, side)
        site.lift = KERB
        _build_side(site, side)
        _furnish_pavement(site, side)
        site.lift = 0.0
        _park(site, side)
    bare = site.scene("street_canyon")
    buildings = furnished(site.buildings, bare.streets(), site.random)
    return replace(bare, buildings=tuple(buildings), is_detailed=True)


def _add_pavement(site: Site, side: int) -> None:
    """All that lies behind the kerb is so much higher than the road."""
    width = WIDTH / 2 - KERB_AT
    slope_x, slope_y = site.terrain.slope
    face = face_over(shapes.box(LENGTH, width), (slope_x, slope_y, KERB))
    site.add_obstacle(building_of("pavement", (face,)), LENGTH / 2, AXIS + side * (KERB_AT + width / 2))


def _build_side(site: Site, side: int) -> None:
    """Lots of random order from one end of the street to the other."""
    lots = ["row", "row", "villa", "villa", "villa", "arcade", "curved", "alley", "alley"]
    x = 5.0
    for kind in site.random.permutation(lots):
        x += float(site.random.uniform(1.5, 3.0))
        x += _LOTS[str(kind)](site, x, side)


def _place(site: Site, shape: Building, x: float, distance: float, side: int) -> None:
    """Stand a building, its −y side to the street at a distance from the axis, its left end at x."""
    (left, bottom, _, _) = shape.polygon.bounds
    # its own x axis runs against the street's on the southern side
    right = shape.polygon.bounds[2]
    middle = x - left if side > 0 else x + right
    site.add_building(shape, middle, AXIS + side * (distance - bottom), 0.0 if side > 0 else 180.0)


def _about(site: Site, low: float, high: float) -> float:
    return round(float(site.random.uniform(low, high)), 2)


def _add_row(site: Site, x: float, side: int) -> float:
    """Two or three town houses wall to wall; the length of the lot [m]."""
    distance, depth, length = _about(site, 6.8, 8.0), 11.0, 0.0
    for _ in range(int(site.random.integers(2, 4))):
        width, eave = _about(site, 6.5, 9.0), _about(site, 6.0, 11.5)
        kind = site.random.choice(["gable", "flat", "shed", "gable"])
        make = {"gable": shapes.gable, "flat": shapes.flat, "shed": shapes.shed}[str(kind)]
        more = {} if kind == "flat" else {"pitch_deg": _about(site, 8, 16) if kind == "shed" else 38.0}
        _place(site, make(width, depth, eave, **more), x + length, distance, side)
        length += width
    return length


def _add_villa(site: Site, x: float, side: int) -> float:
    """A house in a garden behind a hedge, a fence or a wall."""
    width, depth, distance = _about(site, 10, 13), _about(site, 9, 11), _about(site, 9.0, FARTHEST)
    eave, make = _about(site, 3.6, 6.5), (shapes.gable, shapes.hip)[int(site.random.integers(0, 2))]
    _place(site, make(width, depth, eave, pitch_deg=_about(site, 25, 42)), x + 1.0, distance, side)
    kind = str(site.random.choice(["hedge", "fence", "wall"]))
    gate = _about(site, 3.0, width - 3.0)
    for begin, end in ((0.0, gate), (gate + 1.4, width + 2.0)):
        shape = boundary(kind, end - begin, site)
        site.add_obstacle(shape, x + (begin + end) / 2, AXIS + side * FENCE_AT)
    if site.random.uniform() < 0.6:
        radius = _about(site, 0.9, 1.3)
        place = x + _about(site, 1.5, width), AXIS + side * (FENCE_AT + 0.5 + radius)
        if site.add_obstacle(pole(2.4, 0.12), *place):
            site.plant(*place, radius)
    return width + 2.0


def _add_arcade(site: Site, x: float, side: int) -> float:
    """A house of three storeys over an arcade, on which no roof hangs over."""
    n_bays, bay, pier = int(site.random.integers(3, 5)), _about(site, 2.6, 3.2), 0.6
    width = n_bays * (bay + pier) + pier
    shape = shapes.flat(width, 13.0, _about(site, 9, 11))
    deep = _about(site, 2.0, 3.0)
    # edges run counter-clockwise; the one along −y starts at the corner of lowest x
    edge = _edge_to_street(shape)
    bays = [
        Opening("arcade", edge, pier + number * (bay + pier), bay, 0.0, 3.2, deep) for number in range(n_bays)
    ]
    _place(site, replace(shape, openings=tuple(bays)), x, _about(site, NEAREST, 7.0), side)
    return width


def _edge_to_street(shape: Building) -> int:
    """Row of the edge along the lowest y."""
    ring = shape.exterior
    return int(np.argmin((ring[:, 1] + np.roll(ring[:, 1], -1)) / 2))


def _add_curved(site: Site, x: float, side: int) -> float:
    """A house whose front is an arc."""
    width = _about(site, 12, 16)
    shape = curved_front(width, 11.0, _about(site, 7, 12), _about(site, 1.2, 2.2))
    _place(site, shape, x, _about(site, NEAREST, 7.5), side)
    return width


def _add_alley(site: Site, x: float, side: int) -> float:
    """A gap between houses behind a garden wall."""
    length = _about(site, 4, 6)
    site.add_obstacle(boundary("wall", length, site), x + length / 2, AXIS + side * _about(site, 6.5, 8.0))
    return length


_LOTS = {
    "row": _add_row,
    "villa": _add_villa,
    "arcade": _add_arcade,
    "curved": _add_curved,
    "alley": _add_alley,
}


def _furnish_pavement(site: Site, side: int) -> None:
    """Lamp posts, street trees and people."""
    for x in np.arange(12.0, LENGTH - 5.0, 24.0):
        at = float(x + site.random.uniform(-3, 3)), AXIS + side * (KERB_AT + 0.4)
        site.add_obstacle(pole(_about(site, 4.5, 7.0), 0.09), *at)
    for x in site.random.uniform(8.0, LENGTH - 8.0, 3):
        place = float(x), AXIS + side * (KERB_AT + 0.7)
        if site.add_obstacle(pole(2.6, 0.15), *place):
            site.plant(*place, _about(site, 1.1, 1.6))
    for x in site.random.uniform(5.0, LENGTH - 5.0, 6):
        aside = KERB_AT + float(site.random.uniform(0.7, 1.6))
        site.add_obstacle(person(_about(site, 1.5, 1.9)), float(x), AXIS + side * aside, float(10 * x))


def _park(site: Site, side: int) -> None:
    """Cars, vans and a lorry along the kerb."""
    x = 8.0
    for kind in site.random.permutation(["car"] * 9 + ["van"] * 2 + ["lorry"]):
        x += float(site.random.uniform(0.8, 10.0))
        shape = {"car": car, "van": van, "lorry": lorry}[str(kind)](site)
        length = float(np.ptp(shape.exterior[:, 0]))
        if x + length > LENGTH - 5.0:
            return
        turn = float(site.random.uniform(-2, 2)) + (180.0 if side > 0 else 0.0)
        site.add_obstacle(shape, x + length / 2, AXIS + side * PARKED_AT, turn)
        x += length


def _boxes(kind: str, *boxes: tuple[float, float, float, float]) -> Building:
    """Boxes side by side along x: from, to, width and height of each; the widest comes first."""
    faces = tuple(
        face_over(shapely.box(begin, -width / 2, end, width / 2), (0.0, 0.0, height))
        for begin, end, width, height in boxes
    )
    return building_of(kind, faces)


def car(site: Site) -> Building:
    """Return a car with bonnet, cabin and boot."""
    length = _about(site, 3.9, 4.7)
    bonnet, boot, width = 0.26 * length, 0.13 * length, 1.78
    half, height = length / 2, _about(site, 1.4, 1.6)
    shape = _boxes(
        "car",
        (-half, -half + boot, width, 0.95),
        (-half + boot, half - bonnet, width, height),
        (half - bonnet, half, width, 0.85),
    )
    return replace(shape, clearance=0.22)


def van(site: Site) -> Building:
    """Return a delivery van."""
    length = _about(site, 5.0, 6.0)
    half = length / 2
    shape = _boxes("car", (-half, half - 1.0, 2.0, 2.4), (half - 1.0, half, 2.0, 1.2))
    return replace(shape, clearance=0.25)


def lorry(site: Site) -> Building:
    """Return a lorry with a cab and a box."""
    length = _about(site, 7.0, 9.0)
    half = length / 2
    shape = _boxes("lorry", (-half, half - 2.0, 2.2, 3.4), (half - 2.0, half, 2.2, 2.7))
    return replace(shape, clearance=0.6)


def boundary(kind: str, length: float, site: Site) -> Building:
    """Return a hedge, a fence or a garden wall along x."""
    thick, low, high = {
        "hedge": (0.8, 1.2, 2.2),
        "fence": (0.06, 1.1, 1.9),
        "wall": (0.28, 0.8, 2.0),
    }[kind]
    shape = shapes.flat(length, thick, _about(site, low, high))
    return replace(shape, roof_type=kind)


def _prism(kind: str, radius: float, height: float, ratio: float = 1.0) -> Building:
    """Eight sides."""
    angle = np.arange(8) * np.pi / 4
    polygon = shapely.Polygon(np.column_stack([radius * np.cos(angle), ratio * radius * np.sin(angle)]))
    return building_of(kind, (face_over(polygon, (0.0, 0.0, height)),))


def pole(height: float, radius: float) -> Building:
    """Return a pole or the trunk of a tree."""
    return _prism("pole", radius, height)


def person(height: float) -> Building:
    """Return somebody who stands."""
    return _prism("person", 0.28, height, 0.6)


def curved_front(length: float, width: float, eave: float, rise: float) -> Building:
    """Return a flat house whose −y side is an arc that stands out by `rise` [m]."""
    half = length / 2
    radius = (half**2 + rise**2) / (2 * rise)
    reach = np.arcsin(half / radius)
    angle = np.linspace(-reach, reach, max(8, round(length)))
    arc = np.column_stack(
        [radius * np.sin(angle), -width / 2 + (radius * np.cos(reach)) - radius * np.cos(angle)]
    )
    polygon = shapely.Polygon([*arc, (half, width / 2), (-half, width / 2)])
    return building_of("curved_front", (face_over(polygon, (0.0, 0.0, eave)),))
