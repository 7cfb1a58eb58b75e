"""Terrain scenes with works of man: halls, blocks, bridges, embankments, ramps, walls, vehicles."""

from __future__ import annotations

import numpy as np

from bench.scenes.terrain_site import GROUND, TerrainScene, TerrainSite, ramp, waves


def large_hall(*, density=2.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """A flat hall of 120 × 60 m, 9 m high, with a parapet, on level ground."""
    site = TerrainSite(200, 140, density, seed, waves(0.1, 70))
    depth = site.box(100, 70, 120, 60)
    site.put(depth, GROUND + 9 + 0.7 * (depth < 0.6))
    return site.scanned(noise, rotation_deg)


def hall_in_hillside(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """A hall of 50 × 40 m built into a slope of 20 %: its flat roof meets the hill at the back, 8 m up."""
    site = TerrainSite(130, 130, density, seed, lambda x, y: 0.2 * np.clip(y - 40, 0, 60) + 0.05 * x)
    site.put(site.box(65, 60, 50, 40), GROUND + 8 + 0.05 * 65)
    return site.scanned(noise, rotation_deg)


def city_block(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """Four closed blocks, 15 to 22 m high, with courtyards 6 m wide; streets of 12 m between them."""
    site = TerrainSite(135, 130, density, seed, lambda x, y: 0.02 * x)
    for x, y in ((36, 34), (100, 34), (36, 96), (100, 96)):
        block = site.box(x, y, 52, 50)
        height = 15 + 7 * site.random.random()
        courtyards = np.maximum(site.box(x - 12, y, 6, 24), site.box(x + 12, y, 6, 10))
        solid = np.minimum(block, -courtyards)
        site.put(solid, GROUND + height + 3 * ramp(solid, 0, 8))
    return site.scanned(noise, rotation_deg)


def bridge_over_cut(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """A road 9 m wide crosses a cut 7 m deep on a bridge level with the terrain: the deck is an object."""
    site = TerrainSite(140, 120, density, seed, waves(0.15, 60))
    depth_of_cut = 7 * (1 - ramp(abs(site.x - 70), 9, 20))
    site.shape_terrain(depth_of_cut > 0, site.terrain - depth_of_cut)
    deck = site.box(70, 60, 36, 9)
    site.shape_terrain((site.box(70, 60, 50, 9) > 0) & (deck <= 0), GROUND + 0.3)
    site.put(deck, GROUND + 0.3 + 1.0 * (4.5 - abs(site.y - 60) < 0.3), walls=False)
    return site.scanned(noise, rotation_deg)


def overpass_with_ramps(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """
    A road climbs an embankment at 7 %, passes 6.3 m above another on a deck of 24 m, and descends again.
    """
    site = TerrainSite(220, 80, density, seed, waves(0.1, 50))
    height = 6.3 * (1 - ramp(abs(site.x - 110), 12, 102))
    side = abs(site.y - 40)
    bank = np.minimum(height, height - (side - 5) / 1.5)
    bank = np.where(abs(site.x - 110) > 12, bank, height - (side - 5) / 1.5 - 4 * (12 - abs(site.x - 110)))
    site.shape_terrain(bank > 0.1, GROUND + np.where(side < 5, np.minimum(bank, height), bank))
    deck = site.box(110, 40, 24, 10)
    site.put(np.where(GROUND + 6.3 - site.terrain > 1, deck, -1.0), GROUND + 6.3, walls=False)
    return site.scanned(noise, rotation_deg)


def motorway_embankment(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """A motorway on a bank 6 m high (sides 1:1.5) with noise barriers and lorries; houses at its foot."""
    site = TerrainSite(130, 140, density, seed, waves(0.2, 50))
    bank = 6 * (1 - ramp(abs(site.x - 65), 14, 23))
    site.shape_terrain(bank > 0, site.terrain + bank)
    for x in (52, 78):
        site.put(site.box(x, 70, 0.8, 100), site.terrain + 3, walls=False)
    for _ in range(8):
        x, y = site.random.choice([57.0, 61.0, 69.0, 73.0]), site.random.uniform(5, 135)
        site.put(site.box(x, y, 2.5, 14), site.terrain + 3.8)
    for y in (25, 60, 95):
        site.house(20, y, 14, 10, 5, 9)
        site.house(112, y, 12, 10, 4, 8)
    return site.scanned(noise, rotation_deg)


def low_walls_and_hedges(*, density=6.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """Gardens parted by walls and hedges 0.8 to 1.5 m high and 0.3 to 1.2 m wide."""
    site = TerrainSite(96, 96, density, seed, waves(0.3, 60))
    for line in np.arange(10, 90, 12.0):
        for offset in (24.0, 72.0):
            width, height = site.random.uniform((0.3, 0.8), (1.2, 1.5))
            rough = 0.2 * site.random.random(len(site.z)) * (width > 0.7)
            site.put(site.box(offset, line, 40, width), site.terrain + height - rough, walls=False)
    site.put(site.box(48, 48, 1.0, 90), site.terrain + 1.2, walls=False)
    return site.scanned(noise, rotation_deg)


def garage_ramp(*, density=6.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """Ramps 6 m wide go down 3.5 m between walls and under a building of 40 × 30 m; they are ground."""
    site = TerrainSite(100, 90, density, seed, waves(0.05, 40))
    for y in (35, 55):
        way = site.box(28, y, 24, 6)
        site.shape_terrain(way > 0, site.terrain - 3.5 * ramp(site.x, 16, 40))
    site.put(site.box(60, 45, 40, 30), GROUND + 12)
    return site.scanned(noise, rotation_deg)


def houses_on_hillside(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """A settlement of small houses on a slope of 35 %; retaining walls hold up every house's garden."""
    site = TerrainSite(130, 130, density, seed, lambda x, y: 0.35 * y + 0.08 * x)
    for x in np.arange(18, 125, 24.0):
        for y in np.arange(20, 120, 28.0):
            x_here, y_here = np.array([x, y]) + site.random.uniform(-3, 3, 2)
            level = GROUND + 0.35 * y_here + 0.08 * x_here
            site.shape_terrain(site.box(x_here, y_here, 16, 14) > 0, level)
            site.house(x_here, y_here, 11, 8, 4, 7, 90 * site.random.integers(2))
    return site.scanned(noise, rotation_deg)


def sparse_suburb(*, density=0.16, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """Houses, trees and two sheds of 60 × 30 m in rolling country, at one point in six square metres."""
    site = TerrainSite(450, 450, density, seed, waves(4.0, 250))
    for x in np.arange(30, 440, 35.0):
        for y in np.arange(30, 300, 35.0):
            site.house(x, y, *site.random.uniform((9, 8), (16, 11)), 4, 8, site.random.uniform(0, 180))
    for x in (120, 300):
        nearest = np.argmin(np.hypot(site.x - x, site.y - 370))
        site.put(site.box(x, 370, 60, 30), site.terrain[nearest] + 7)
    for x, y in site.random.uniform(0, 450, (250, 2)):
        site.tree(x, y, *site.random.uniform((3, 6), (6, 18)))
    return site.scanned(noise, rotation_deg)


def dense_street(*, density=40.0, noise=0.02, rotation_deg=0.0, seed=0) -> TerrainScene:
    """A street between houses, with kerbs, parked cars in rows, people and lamp posts, at 40 pts/m²."""
    site = TerrainSite(36, 38, density, seed, lambda x, y: 0.03 * x)
    kerb = (abs(site.y - 19) > 6) & (abs(site.y - 19) < 9)
    site.shape_terrain(kerb, site.terrain + 0.14)
    for y in (4.5, 33.5):
        site.put(site.box(18, y, 36, 11), GROUND + 11)
    for x in np.arange(4, 34, 5.4):
        for y in (14.2, 23.8):
            _car(site, x + site.random.uniform(-0.3, 0.3), y)
    for x, y in site.random.uniform((0, 10.5), (36, 27.5), (25, 2)):
        site.put(site.disc(x, y, 0.25), site.terrain + 1.7, walls=False)
    for x in (9.0, 27.0):
        site.put(site.disc(x, 12.8, 0.3), site.terrain + 5.0, walls=False)
    return site.scanned(noise, rotation_deg)


def _car(site: TerrainSite, x: float, y: float) -> None:
    """Park a car along x: bonnet 0.9 m, cabin 1.45 m high."""
    site.put(site.box(x, y, 4.4, 1.8), site.terrain + 0.9, walls=False)
    site.put(site.box(x - 0.3, y, 2.4, 1.6), site.terrain + 1.45, walls=False)
