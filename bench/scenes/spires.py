"""Steep roofs under the virtual scanner: spires, conical turrets, mansards and A-frames, one a scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from bench.scenes.roof_site import GROUND, Box, Disc, RoofScene, RoofSite, Shape
from bench.scenes.roof_site_beams import Array

#: Side of a scene [m].
SIDE = 46.0
#: Plans so near one another are one [m].
CLOSE = 0.05
PLANS = ("square", "octagon", "cone")
STANDS = ("free", "gable end", "corner", "ridge")


class Polygon(NamedTuple):
    """A regular polygon about a middle, by the radius of the circle within [m]."""

    x: float
    y: float
    radius: float
    n_sides: int
    angle_deg: float = 0.0

    def depth(self, x: Array, y: Array) -> Array:
        """How deep positions lie inside; negative outside."""
        angle = np.deg2rad(self.angle_deg) + 2 * np.pi * np.arange(self.n_sides) / self.n_sides
        sides = [np.cos(one) * (x - self.x) + np.sin(one) * (y - self.y) for one in angle]
        return self.radius - np.max(sides, axis=0)

    def extent(self) -> tuple[float, float, float]:
        """Middle, and how far from it the shape reaches."""
        return self.x, self.y, self.radius / float(np.cos(np.pi / self.n_sides))


class SteepRoof(NamedTuple):
    """A scene with one steep roof, and what is true of it."""

    scene: RoofScene
    shape: Shape  #: its plan
    footprint: shapely.Polygon  #: of the building that it is of
    bottom: float  #: elevation of its eaves [m]
    top: float  #: and of its highest point [m]


def spire(
    plan: str, stand: str, slope_deg: float, *, density: float, seed: int = 0, noise: float = 0.03
) -> SteepRoof:
    """Put a spire 4 to 7 m wide upon a shaft, free, at a nave's gable end or corner, or on its ridge."""
    random = np.random.default_rng([seed, PLANS.index(plan), STANDS.index(stand), round(slope_deg)])
    site = RoofSite(SIDE, SIDE, density, seed)
    width, angle = random.uniform(4.0, 7.0), random.uniform(0.0, 90.0)
    x, y = np.array([SIDE, SIDE]) / 2 + random.uniform(-0.5, 0.5, 2)
    along = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    across = np.array([-along[1], along[0]])
    shaft, others = random.uniform(10.0, 18.0), []
    if stand != "free":
        away = {"gable end": (10 + width / 2, 0), "corner": (10, 5), "ridge": (0, 0)}[stand]
        nave_x, nave_y = (x, y) + away[0] * along + away[1] * across
        others = [site.house(nave_x, nave_y, 20, 10, 7, 50, angle)]
        shaft = max(shaft, 14.5) if stand == "ridge" else shaft
    shapes: dict[str, Shape] = {
        "square": Box(x, y, width, width, angle),
        "octagon": Polygon(x, y, width / 2, 8, angle),
        "cone": Disc(x, y, width / 2),
    }
    shape, bottom, rise = shapes[plan], GROUND + shaft, float(np.tan(np.deg2rad(slope_deg)))
    site.put(shape, lambda x, y: bottom + rise * shape.depth(x, y))
    return _scanned(site, shape, others, bottom, bottom + rise * width / 2, noise)


def _scanned(
    site: RoofSite, shape: Shape, others: Sequence[Shape], bottom: float, top: float, noise: float
) -> SteepRoof:
    # What touches is one.
    grown = shapely.union_all([_polygon(one).buffer(CLOSE, join_style="mitre") for one in (shape, *others)])
    footprint = grown.buffer(-CLOSE, join_style="mitre").simplify(CLOSE)
    return SteepRoof(site.scanned(noise, 0.0, max_angle_deg=15.0), shape, footprint, bottom, top)


def _polygon(shape: Shape) -> shapely.Polygon:
    """Return the plan of a convex shape: how far it reaches in each of many directions."""
    x, y, reach = shape.extent()
    angle = np.deg2rad(np.arange(0.0, 360.0, 0.5))
    low, high = np.zeros(len(angle)), np.full(len(angle), 1.01 * reach)
    for _ in range(30):
        middle = (low + high) / 2
        inside = shape.depth(x + middle * np.cos(angle), y + middle * np.sin(angle)) > 0.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return shapely.Polygon(np.column_stack((x + low * np.cos(angle), y + low * np.sin(angle)))).simplify(0.01)


def a_frame(slope_deg: float, *, density: float, seed: int = 0, noise: float = 0.03) -> SteepRoof:
    """Put a house whose two roofs reach down to the ground."""
    random = np.random.default_rng(seed)
    site = RoofSite(SIDE, SIDE, density, seed)
    box = Box(SIDE / 2, SIDE / 2, random.uniform(9, 14), random.uniform(5, 8), random.uniform(0, 90))
    bottom, rise = GROUND + 0.5, float(np.tan(np.deg2rad(slope_deg)))
    site.put(box, lambda x, y: bottom + rise * (box.width / 2 - abs(box.local(x, y)[1])))
    return _scanned(site, box, (), bottom, bottom + rise * box.width / 2, noise)


def mansard(slope_deg: float, *, density: float, seed: int = 0, noise: float = 0.03) -> SteepRoof:
    """Put a house with a flat top of 1 to 1.5 m less than its plan all round, and steep sides."""
    random = np.random.default_rng(seed)
    site = RoofSite(SIDE, SIDE, density, seed)
    box = Box(SIDE / 2, SIDE / 2, random.uniform(12, 18), random.uniform(9, 13), random.uniform(0, 90))
    rise, height = float(np.tan(np.deg2rad(slope_deg))), random.uniform(3.0, 5.0)
    site.put(box, lambda x, y: GROUND + 7 + np.minimum(rise * box.depth(x, y), height))
    return _scanned(site, box, (), GROUND + 7, GROUND + 7 + height, noise)
