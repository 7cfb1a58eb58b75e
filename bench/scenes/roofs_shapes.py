"""Roof scenes about the shapes of roofs: steep, curved, stepped, high, with parapets, dormers, courtyards."""

from __future__ import annotations

import numpy as np

from bench.scenes.roof_site import EITHER, GROUND, OBJECT, Box, Disc, Hollow, RoofScene, RoofSite


def dormers_and_chimneys(*, density=12.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Gable houses with dormers of three widths, chimneys, and skylights without returns."""
    site = RoofSite(56, 44, density, seed)
    for x, y in ((14, 12), (42, 12), (14, 32), (42, 32)):
        site.house(x, y, 16, 10, 5, 42)
        for place, width in ((-5, 1.4), (0, 2.4), (5, 3.2)):
            site.put(Box(x + place, y - 2.9, width, 2.8), GROUND + 5 + 3.1 + 0.2 * width)
        site.put(Box(x + 3, y + 0.8, 0.9, 0.6), GROUND + 10.8)
        site.put(Box(x - 4, y + 0.4, 1.3, 0.7), GROUND + 11.2)
        site.lose(Box(x, y + 2.5, 1.2, 1.6), 1.0)
    return site.scanned(noise, rotation_deg)


def steep_roofs(*, density=10.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Gables of 50 and 60°, a mansard, a church with a tower and a spire of 70°."""
    site = RoofSite(64, 56, density, seed)
    site.house(13, 12, 14, 9, 4, 50)
    site.house(13, 30, 14, 9, 4, 60, 20)
    site.house(13, 46, 9, 9, 4, 55, roof="hip")
    mansard = Box(38, 12, 18, 12)
    site.put(mansard, lambda x, y: GROUND + 6 + np.minimum(2.5 * mansard.depth(x, y), 3.2))
    site.house(40, 38, 24, 11, 9, 55)
    spire = Box(54, 38, 6, 6)
    site.put(spire, lambda x, y: GROUND + 20 + np.tan(np.deg2rad(70)) * spire.depth(x, y))
    return site.scanned(noise, rotation_deg)


def curved_roofs(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Barrel vaults over a hall and over garages, a dome, a shallow shell, a saw-tooth factory."""
    site = RoofSite(76, 60, density, seed)
    site.house(20, 14, 30, 16, 5, 38, roof="barrel")
    for x in (42, 46.5, 51):
        site.house(x, 14, 12, 4.5, 2.6, 25, 90, roof="barrel")
    dome, shell = Disc(16, 42, 9), Disc(40, 42, 10)
    site.put(dome, lambda x, y: GROUND + 6 + np.sqrt(np.clip(81 - (9 - dome.depth(x, y)) ** 2, 0, None)))
    site.put(shell, lambda x, y: GROUND + 5 + 0.25 * shell.depth(x, y) - 0.01 * shell.depth(x, y) ** 2)
    for place in range(4):
        site.house(64, 34 + 5 * place, 18, 5, 5, 25, 0, roof="shed")
    return site.scanned(noise, rotation_deg)


def towers(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """
    Round towers with flat and conical roofs, slabs and point blocks 30 to 60 m high, with lift housings.
    """
    site = RoofSite(90, 64, density, seed)
    site.put(Disc(12, 14, 5), GROUND + 22)
    cone = Disc(12, 44, 4)
    site.put(cone, lambda x, y: GROUND + 14 + 1.4 * cone.depth(x, y))
    site.put(Box(38, 18, 24, 11), GROUND + 32)
    site.put(Box(38, 18, 5, 5), GROUND + 35)
    site.put(Box(38, 48, 8, 8, 30), GROUND + 45)
    site.put(Box(70, 20, 16, 16, 45), GROUND + 60)
    site.put(Box(70, 20, 7, 6, 45), GROUND + 63.5)
    site.house(70, 48, 15, 9, 5, 35)
    return site.scanned(noise, rotation_deg, max_angle_deg=18.0)


def parapet_roofs(*, density=10.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Flat roofs with parapets of 0.4 to 1.2 m, machines, ducts and a lift housing."""
    site = RoofSite(64, 50, density, seed)
    for x, y, length, width, height, parapet in (
        (16, 14, 22, 14, 9, 1.2),
        (48, 14, 18, 18, 12, 0.4),
        (16, 38, 20, 12, 6, 0.8),
        (48, 40, 24, 10, 4, 0.6),
    ):
        whole = Box(x, y, length, width)
        site.put(Hollow(whole, Box(x, y, length - 0.7, width - 0.7)), GROUND + height + parapet)
        site.put(whole, GROUND + height)
        site.put(Box(x + length / 4, y, 3, 3), GROUND + height + 2.6)
        site.put(Box(x - 3, y + 2, 2, 1.2), GROUND + height + 1.4)
        site.put(Box(x - 2, y - 2.5, 8, 0.6), GROUND + height + 0.7)
    return site.scanned(noise, rotation_deg)


def courtyards(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """Perimeter blocks with courtyards of 6 to 14 m, trees and a low pavilion inside."""
    site = RoofSite(84, 48, density, seed)
    for x, width, court in ((22, 32, 14), (64, 28, 6)):
        whole, yard = Box(x, 24, width, 34), Box(x, 24, court, 16)
        ring = Hollow(whole, yard)
        site.put(ring, lambda x, y, ring=ring: GROUND + 12 + 0.6 * np.minimum(ring.depth(x, y), 5))
        site.tree(x - 1, 22, 2.6, 9)
    site.put(Box(22, 29, 7, 4), GROUND + 3)
    site.tree(27, 19, 2, 14)
    return site.scanned(noise, rotation_deg)


def step_roofs(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """A stepped complex with storeys of 1 to 3 m between its roofs, and terraces 3 m deep."""
    site = RoofSite(64, 50, density, seed)
    for place, height in enumerate((4, 5, 7, 10, 13)):
        site.put(Box(10 + 9 * place, 14, 9, 16), GROUND + height)
    for place in range(4):
        site.put(Box(32, 31 + 3 * place, 40, 3), GROUND + 3.2 * (place + 1))
    site.put(Box(32, 43, 40, 4), GROUND + 14.5)
    return site.scanned(noise, rotation_deg)


def row_houses(*, density=8.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """
    Two dense rows of houses 5.4 m wide, of varying height, with rear extensions and trees in the gardens.
    """
    site = RoofSite(72, 46, density, seed)
    for place in range(12):
        x = 6 + 5.4 * place
        for y, back in ((9, 1), (38, -1)):
            eave = 5.5 + 0.5 * site.random.integers(0, 4)
            site.house(x, y, 9, 5.4, eave, 38 + site.random.uniform(-4, 4), 90 if place % 5 == 2 else 0)
            site.house(x, y, 5.4, 9, eave, 38)
            if site.random.random() < 0.7:
                site.put(Box(x, y + back * 6.5, 3.6, 4), GROUND + 3)
            if site.random.random() < 0.5:
                site.tree(x + 1, y + back * 11.5, site.random.uniform(1.5, 2.4), site.random.uniform(4, 8))
    return site.scanned(noise, rotation_deg)


def industrial_hall(*, density=6.0, noise=0.03, rotation_deg=0.0, seed=0) -> RoofScene:
    """A hall of 60 × 36 m with ducts and rooflights; beside it tanks (either), a pipe rack and a conveyor."""
    site = RoofSite(100, 64, density, seed)
    site.house(38, 24, 60, 36, 8, 4)
    for x in np.arange(14, 66, 9.0):
        site.put(Box(x, 16, 4, 2), GROUND + 10)
        site.put(Box(x, 30, 0.7, 14), GROUND + 10.4)
    site.put(Box(38, 24, 58, 0.5), GROUND + 10.6)
    for y in (12, 30):
        site.put(Disc(82, y, 6), GROUND + 9, EITHER)
    site.put(Box(44, 50, 80, 3), GROUND + 5.5, OBJECT)
    conveyor = Box(84, 47, 26, 2.2, 90)
    site.put(conveyor, lambda x, y: GROUND + 4 + 0.35 * (y - 34), OBJECT)
    return site.scanned(noise, rotation_deg)
