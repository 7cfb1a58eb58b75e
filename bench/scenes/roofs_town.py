"""
Roof scenes about what towns put beside and upon roofs: vehicles, bridges, façades, awnings, glass, cranes.
"""

from __future__ import annotations

import numpy as np

from bench.scenes.roof_site import EITHER, GROUND, OBJECT, Box, Disc, RoofScene, RoofSite


def vehicles(*, density=10.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """
    Cars, vans, buses, lorries with trailers, parked side by side and at a loading dock; a hall and a house.
    """
    site = RoofSite(64, 52, density, seed)
    site.put(Box(16, 12, 24, 14), GROUND + 6)
    for x in (8, 12.5, 17, 21.5):
        _vehicle(site, x, 26.2, 2.5, 13.6, 3.9)
    for place in range(8):
        _vehicle(site, 34 + 3 * place, 8, 1.8, 4.4, 1.5)
        _vehicle(site, 34 + 3 * place, 16, 2.0, 5.6, 2.5)
    for place in range(4):
        _vehicle(site, 36 + 3.4 * place, 28, 2.5, 12, 3.2)
    for y in (42, 47):
        _vehicle(site, 20, y, 13.6, 2.5, 4.0)
        _vehicle(site, 30.5, y, 6, 2.4, 3.2)
    site.house(50, 44, 14, 9, 5, 35)
    return site.scanned(noise, rotation_deg)


def _vehicle(site: RoofSite, x: float, y: float, length: float, width: float, height: float) -> None:
    """Park a box-shaped vehicle."""
    site.put(Box(x, y, length, width), site.level(x, y) + height, OBJECT)


def garages_sheds_awnings(*, density=12.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Garages 2.6 m high in rows and alone are buildings; sheds of 1.9 m, parasols and awnings are not."""
    site = RoofSite(60, 46, density, seed)
    for x in (14, 40):
        site.house(x, 12, 16, 9, 5.5, 35)
        site.hang(Box(x - 3, 17.4, 6, 1.8), GROUND + 2.8, 0.95, 0.1)
        site.hang(Disc(x + 4, 20, 1.5), GROUND + 2.5, 0.9, 0.2)
        site.put(Box(x + 8, 24, 3, 2.4), GROUND + 1.9, OBJECT)
        site.put(Box(x - 6, 25, 2.4, 2), GROUND + 1.8, OBJECT)
    site.put(Box(16, 38, 18, 6), GROUND + 2.6)
    site.put(Box(40, 38, 6, 3.2), GROUND + 2.6)
    site.house(52, 36, 7, 5, 2.4, 25)
    return site.scanned(noise, rotation_deg)


def bridges(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """A road bridge over a cut, a footbridge with railings over it, and houses on both sides."""
    site = RoofSite(80, 60, density, seed, lambda x, y: -6.5 * np.clip((14 - abs(x - 40)) / 5, 0, 1))
    site.put(Box(40, 18, 34, 10), GROUND + 0.4, OBJECT)
    for y in (13.2, 22.8):
        site.put(Box(40, y, 34, 0.3), GROUND + 1.5, OBJECT)
    site.put(Box(40, 42, 32, 2.6), GROUND + 0.6, OBJECT)
    for x, y in ((11, 12), (12, 44), (68, 33), (68, 51)):
        site.house(x, y, 13, 9, 5, 35, 90)
    _vehicle(site, 42, 20, 4.4, 1.8, 0.0)
    return site.scanned(noise, rotation_deg)


def facades(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Slabs of 18 to 30 m seen under 25°: much façade, with balconies (either)."""
    site = RoofSite(64, 72, density, seed)
    for y, height in ((12, 18), (36, 30), (60, 24)):
        site.put(Box(32, y, 44, 12), GROUND + height)
        for level in np.arange(3, height - 2, 3.0):
            for x in (16, 26, 38, 48):
                site.hang(Box(x, y - 6.7, 4, 1.4), GROUND + level, 1.0, 0.0, EITHER)
                site.hang(Box(x, y + 6.7, 4, 1.4), GROUND + level, 1.0, 0.0, EITHER)
    return site.scanned(noise, rotation_deg, max_angle_deg=25.0)


def glass(*, density=10.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """
    Roofs that return little: an atrium and rooflights with 60 to 90 % lost, solar panels with 70 % lost.
    """
    site = RoofSite(60, 44, density, seed)
    site.put(Box(18, 14, 28, 16), GROUND + 9)
    site.lose(Box(18, 14, 12, 8), 0.6)
    site.house(46, 14, 16, 10, 5, 35)
    site.lose(Box(46, 11.5, 10, 3.4), 0.7)
    site.house(18, 34, 26, 12, 4, 20, roof="barrel")
    for x in (10, 18, 26):
        site.lose(Box(x, 34, 3, 8), 0.9)
    site.house(46, 34, 14, 10, 3, 25)
    return site.scanned(noise, rotation_deg)


def cranes_and_masts(*, density=10.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """A crane's jib over roofs, masts on them, cables across the street, a scaffold with nets."""
    site = RoofSite(60, 46, density, seed)
    site.house(16, 12, 18, 10, 8, 35)
    site.put(Box(44, 12, 20, 14), GROUND + 14)
    site.put(Box(24, 34, 30, 12), GROUND + 10)
    site.hang(Box(32, 24, 52, 1.4, 25), GROUND + 27, 0.4, 0.5)
    site.put(Box(31, 23, 1.6, 1.6), GROUND + 26, OBJECT)
    for x, y, top in ((44, 14, 19), (40, 9, 17.5), (16, 12, 16)):
        site.put(Disc(x, y, 0.25), GROUND + top, EITHER)
    for y in (22, 23):
        site.hang(Box(30, y, 58, 0.15), GROUND + 7, 0.6, 0.6)
    site.hang(Box(24, 41, 30, 1.8), GROUND + 8, 0.6, 0.4, EITHER)
    return site.scanned(noise, rotation_deg)


def dense_block(*, density=60.0, noise=0.02, rotation_deg=0.0, seed=0) -> RoofScene:
    """A street at 60 pts/m²: houses with dormers, chimneys and gutters, cars, lamps, a tree over an eave."""
    site = RoofSite(30, 28, density, seed)
    site.house(8, 6, 14, 9, 6, 40)
    site.put(Box(8, 3.4, 2.4, 2.6), GROUND + 9.6)
    site.put(Box(11, 6.5, 0.9, 0.6), GROUND + 11.2)
    site.put(Box(22.5, 6, 13, 9), GROUND + 9)
    site.house(9, 22.5, 16, 9, 4, 30, roof="hip")
    for x in (3, 9, 15, 21):
        _vehicle(site, x, 13, 4.4, 1.8, 1.5)
    _vehicle(site, 25, 16, 7, 2.4, 3.2)
    for x in (6, 18):
        site.put(Disc(x, 15.5, 0.2), GROUND + 5, OBJECT)
    site.tree(18, 20, 2.4, 9)
    site.tree(26, 23, 2.6, 7)
    return site.scanned(noise, rotation_deg)
