"""Roof scenes about plants: trees beside, over and without houses, hedges, green roofs, hillsides."""

from __future__ import annotations

import numpy as np

from bench.scenes.roof_site import GROUND, OBJECT, PLANT, Box, RoofScene, RoofSite


def trees_over_roofs(*, density=10.0, noise=0.03, rotation_deg=0.0, seed=0, returns=True) -> RoofScene:
    """Houses with trees beside them, over their eaves and ridges, and with crowns that touch the eave."""
    site = RoofSite(64, 52, density, seed)
    for x, y in ((14, 14), (34, 14), (52, 14), (14, 38), (34, 38), (52, 38)):
        site.house(x, y, 12, 8, 4.5, 35)
    site.tree(8, 9, 3.2, 11)
    site.tree(19, 19, 2.5, 8)
    site.tree(34, 8.5, 2.4, 6)
    site.tree(40, 18, 4, 13)
    site.tree(52, 14, 3, 14)
    site.tree(58.8, 14, 1.8, 5.5)
    site.tree(7, 38, 2.6, 7)
    site.tree(30, 32.5, 3.5, 10)
    site.tree(52, 45, 3.5, 12)
    site.tree(45.5, 40, 2, 6)
    return site.scanned(noise, rotation_deg, returns=returns)


def without_returns(*, density=10.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """The same without return numbers and intensities."""
    return trees_over_roofs(density=density, noise=noise, rotation_deg=rotation_deg, seed=seed, returns=False)


def hedges_and_walls(*, density=12.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """
    Clipped hedges 2.2 to 3 m high and 1.2 to 2 m wide, garden walls, a noise barrier of 4 m; two houses.
    """
    site = RoofSite(56, 48, density, seed)
    for y, width, height in ((6, 1.2, 2.3), (14, 1.6, 2.6), (22, 2.0, 3.0)):
        _hedge(site, Box(18, y, 28, width), height)
        _hedge(site, Box(18 + 14, y + 4, 8, width, 90), height)
    site.put(Box(18, 30, 30, 0.35), GROUND + 2.4, OBJECT)
    site.put(Box(4, 20, 0.35, 20), GROUND + 2.8, OBJECT)
    site.put(Box(28, 44, 52, 0.4), GROUND + 4, OBJECT)
    site.house(46, 12, 14, 9, 4.5, 35, 90)
    site.house(44, 33, 14, 9, 3, 25)
    return site.scanned(noise, rotation_deg)


def _hedge(site: RoofSite, box: Box, height: float) -> None:
    """A hedge with a clipped top, uneven by 0.1 m."""
    wave = site.random.uniform(1.5, 2.5, 2)
    site.put(
        box,
        lambda x, y: GROUND + height + 0.2 * np.sin(x * wave[0] * 3) * np.cos(y * wave[1] * 4),
        PLANT,
    )


def forest_edge(*, density=7.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """
    Dense wood of leafy trees and conifers, clipped planes with flat crowns, an orchard; one hut among them.
    """
    site = RoofSite(72, 56, density, seed)
    for x, y in np.stack(np.meshgrid(np.arange(4, 40, 4.6), np.arange(4, 54, 4.8)), axis=-1).reshape(-1, 2):
        if abs(x - 22) + abs(y - 30) > 7:
            dx, dy = site.random.uniform(-1, 1, 2)
            site.tree(x + dx, y + dy, site.random.uniform(2, 3.4), site.random.uniform(9, 20))
    site.house(22, 30, 7, 5, 2.6, 30)
    for y in np.arange(8, 52, 5.0):
        site.tree(48, y, 2.6, 5.5, 0.35, first_leaf=0.15, passes=0.3)
        site.tree(60, y, 1.9, 3.6, 0.6, first_leaf=0.3)
    return site.scanned(noise, rotation_deg)


def roof_gardens(*, density=10.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Flat roofs with rough low green, with tubs and shrubs of 1 to 2 m, and with small trees."""
    site = RoofSite(64, 46, density, seed)
    rough = site.random.uniform(0.8, 1.6, 2)
    site.put(
        Box(16, 13, 24, 16),
        lambda x, y: GROUND + 8 + 0.06 * np.sin(x * 5 * rough[0]) * np.cos(y * 6 * rough[1]),
    )
    site.put(Box(48, 13, 22, 16), GROUND + 7)
    for x, y in site.random.uniform((39, 7), (57, 19), (9, 2)):
        site.tree(x, y, site.random.uniform(0.5, 0.9), 0, 0)
        site.crowns[-1] = site.crowns[-1]._replace(z=GROUND + 8.0, half_height=0.9, first_leaf=0.2)
    site.put(Box(30, 36, 40, 12), GROUND + 10)
    for x in (16, 24, 33, 42):
        site.tree(x, 36, 1.8, 0, 0)
        site.crowns[-1] = site.crowns[-1]._replace(z=GROUND + 13.2, half_height=1.6)
    return site.scanned(noise, rotation_deg)


def hillside(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Houses on a slope of 30 %, one with its eave near the ground uphill; trees, terrace walls of 2.5 m."""
    site = RoofSite(72, 56, density, seed, lambda x, y: 0.3 * y + 0.04 * x)
    for x, y, angle in ((14, 14, 0), (40, 14, 30), (16, 40, 90), (42, 42, 0)):
        site.house(x, y, 13, 9, 5, 33, angle)
    site.put(Box(62, 30, 12, 10), site.level(62, 34) + 1.5)
    for y in (24, 28):
        site.put(Box(30, y, 30, 0.4), lambda x, y: site.world.terrain(x, y) + 2.5, OBJECT)
    for x, y in site.random.uniform((3, 3), (69, 53), (14, 2)):
        site.tree(x, y, site.random.uniform(1.8, 3), site.random.uniform(5, 12))
    return site.scanned(noise, rotation_deg)


def sparse_suburb(*, density=1.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Houses, garages and trees at 1 pt/m²."""
    site = RoofSite(150, 120, density, seed)
    roofs = ("gable", "hip", "flat", "shed")
    for place, (x, y) in enumerate(
        np.stack(np.meshgrid(np.arange(16, 150, 24.0), np.arange(16, 120, 28.0)), axis=-1).reshape(-1, 2)
    ):
        roof = roofs[place % 4]
        site.house(x, y, 14, 9, 4, 12 if roof == "shed" else 33, site.random.uniform(0, 180), roof)
        site.house(x + 11, y + 9, 6, 3.5, 2.6, roof="flat")
        site.tree(x - 10, y + 11, site.random.uniform(2, 4), site.random.uniform(6, 12))
        site.tree(
            x + site.random.uniform(-4, 4), y - 9, site.random.uniform(2, 3.5), site.random.uniform(6, 10)
        )
    return site.scanned(noise, rotation_deg)
