"""
Terrain scenes of the open country: quarry, banks, forest, vineyard, dyke, gaps in the data, gross errors.
"""

from __future__ import annotations

import numpy as np

from bench.scenes.terrain_site import GROUND, TerrainScene, TerrainSite, ramp, waves

#: Gross errors come in groups of these sizes.
CLUMPS = (1, 1, 1, 2, 3, 5, 8, 13, 20, 35, 60)


def quarry(*, density=2.0, noise=0.05, rotation_deg=0.0, seed=0) -> TerrainScene:
    """
    Four winding terraces; the cliffs between them are 12 m high and 60 to 80° steep. Diggers work on them.
    """
    site = TerrainSite(160, 160, density, seed, waves(0.4, 45))
    bend = 6 * np.sin(site.x / 14) + 3 * np.cos(site.x / 6)
    for edge, steepness_deg in ((30, 60), (60, 67), (90, 74), (125, 80)):
        run = 12 / np.tan(np.deg2rad(steepness_deg))
        rise = 12 * ramp(site.y + bend, edge, edge + run)
        site.shape_terrain(rise > 0, site.terrain + rise)
    for x, y in ((30, 15), (80, 48), (120, 110)):
        site.put(site.box(x, y, 9, 4, 30), site.terrain + 3.5, walls=False)
    return site.scanned(noise, rotation_deg)


def river_bank(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """
    A river with few returns (ground) between a natural bank of 3 m, a quay wall, trees, a boat and houses.
    """
    site = TerrainSite(130, 130, density, seed, waves(0.3, 55))
    middle = 65 + 4 * np.sin(site.y / 20)
    fall = 3 * ramp(site.x, middle - 19, middle - 15)
    water = abs(site.x - middle) < 15
    site.shape_terrain(fall > 0, site.terrain - fall)
    site.shape_terrain(site.x >= middle + 15, GROUND + waves(0.3, 55)(site.x, site.y))
    site.shape_terrain(water, GROUND - 3.6)
    site.keep(~water | (site.random.random(len(site.z)) < 0.15) | (site.disc(65, 70, 8) > 0))
    site.put(site.box(66, 70, 4, 12), GROUND - 1.2)
    for y in np.arange(8, 125, 13.0):
        site.tree(44 + 4 * np.sin(y / 20), y, 3.5, 9)
        site.house(100, y + 4, 10, 8, 5, 8)
    return site.scanned(noise, rotation_deg)


def steep_forest(*, density=5.0, noise=0.05, rotation_deg=0.0, seed=0) -> TerrainScene:
    """
    A ridge and a gully of 30 to 40° under trees and dense low plants (0.5 to 2 m): 20 % reach the ground.
    """
    site = TerrainSite(100, 100, density, seed, _ridge_and_gully)
    canopy = site.random.random(len(site.z)) < 0.45
    crown = 14 + 6 * np.sin(site.x / 3.1) * np.cos(site.y / 3.7)
    heights = crown * site.random.uniform(0.4, 1, len(canopy))
    site.z[canopy], site.is_ground[canopy] = (site.terrain + heights)[canopy], False
    site.grow(1 - 0.20 / 0.55, 0.5, 2.0)
    return site.scanned(noise, rotation_deg)


def _ridge_and_gully(x, y):
    """Slopes that rise and fall by 30 to 40° along x, with a rough face."""
    across = abs((x + 4 * np.sin(y / 12)) - 35)
    ridge = 30 - np.tan(np.deg2rad(35)) * np.minimum(across, 40)
    beyond = np.tan(np.deg2rad(30)) * np.clip(across - 46, 0, None)
    return ridge + beyond + 0.25 * np.sin(x / 1.9) * np.sin(y / 2.3) + 0.1 * y


def terraced_vineyard(*, density=5.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """Terraces 8 m wide behind walls of 1.8 m; vines 1.2 to 1.8 m high in rows 2 m apart."""
    site = TerrainSite(105, 105, density, seed)
    along = site.y + 3 * np.sin(site.x / 18)
    step = np.floor(along / 8)
    site.shape_terrain(along > -10, GROUND + 1.8 * (step + ramp(along - 8 * step, 7.6, 8)))
    row = (along % 8 > 1) & (along % 8 < 7) & (abs(along % 2 - 1) < 0.3)
    heights = site.random.uniform(1.2, 1.8, len(along))
    site.put(
        np.where(row & (site.random.random(len(row)) < 0.8), 1.0, -1.0), site.terrain + heights, walls=False
    )
    return site.scanned(noise, rotation_deg)


def lake_gap(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """A lake of 40 m across without any return, in a slope, with houses and trees on its shore."""
    site = TerrainSite(130, 130, density, seed, lambda x, y: 0.08 * y + waves(0.5, 60)(x, y))
    site.house(34, 65, 14, 10, 5, 9)
    site.house(96, 65, 14, 10, 5, 9, 90)
    for angle in np.arange(0.4, 6.2, 0.7):
        site.tree(65 + 23 * np.cos(angle), 65 + 23 * np.sin(angle), 3, 10)
    site.keep(site.disc(65, 65, 20) < 0)
    return site.scanned(noise, rotation_deg)


def strip_edges(*, density=4.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """
    Two strips of data 30 m wide, ending in the middle of houses and of a hall, with 40 m of nothing between.
    """
    site = TerrainSite(140, 160, density, seed, waves(0.8, 80))
    for y in np.arange(12, 160, 24.0):
        for x in (20, 49, 91, 122):
            site.house(x, y, 14, 10, 5, 9, 15 * site.random.integers(12))
    site.put(site.box(50, 80, 30, 44), GROUND + 9)
    slant = site.x + 0.1 * (site.y - 80)
    site.keep(((slant > 20) & (slant < 50)) | ((slant > 90) & (slant < 120)))
    return site.scanned(noise, rotation_deg)


def low_outliers(*, density=2.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """Groups of 1 to 60 gross errors, 2 to 10 m below gently rolling ground with houses."""
    site = TerrainSite(160, 160, density, seed, waves(1.0, 90))
    for x in np.arange(25, 150, 40.0):
        for y in np.arange(25, 150, 40.0):
            site.house(x, y, 14, 11, 5, 9)
    clumps = [_clump(site, size) for size in CLUMPS for _ in range(2)]
    site.add(np.concatenate(clumps))
    return site.scanned(noise, rotation_deg)


def _clump(site: TerrainSite, size: int) -> np.ndarray:
    """A group of gross errors below the terrain, within 3 m of one another."""
    xy = site.random.uniform(5, site.size - 5)
    nearest = np.argmin(np.hypot(site.x - xy[0], site.y - xy[1]))
    spread = site.random.uniform(-1.5, 1.5, (size, 3)) * (1, 1, 0.2)
    return np.array([*xy, site.terrain[nearest] - site.random.uniform(2.5, 9.5)]) + spread


def dyke_and_mound(*, density=3.0, noise=0.03, rotation_deg=0.0, seed=0) -> TerrainScene:
    """A dyke 5 m high with sides of 1:2.5, and a burial mound 5 m high and 24 m across; a few trees."""
    site = TerrainSite(130, 130, density, seed, waves(0.1, 60))
    dyke = 5 * (1 - ramp(abs(site.x - 35 - 5 * np.sin(site.y / 25)), 2, 14.5))
    mound = 5 * np.clip(site.disc(92, 70, 12) / 12, 0, 1) ** 0.7
    rise = np.maximum(dyke, mound)
    site.shape_terrain(rise > 0, site.terrain + rise)
    for x, y in site.random.uniform((70, 5), (125, 125), (12, 2)):
        site.tree(x, y, 3.5, 9)
    return site.scanned(noise, rotation_deg)


def mountain_ridge(*, density=2.0, noise=0.05, rotation_deg=0.0, seed=0) -> TerrainScene:
    """Two knife-edge ridges of 45°, a summit between, and boulders of 2 m; no plant anywhere."""
    site = TerrainSite(150, 150, density, seed, _ridges)
    for x, y in site.random.uniform(5, 145, (40, 2)):
        dome = 2 * np.sqrt(np.clip(1 - (1 - np.clip(site.disc(x, y, 1.8), 0, None) / 1.8) ** 2, 0, 1))
        site.put(np.where(dome > 0.6, 1.0, -1.0), site.terrain + dome, walls=False)
    return site.scanned(noise, rotation_deg)


def _ridges(x, y):
    """The upper surface of two slanting roofs and a cone."""
    first = 30 - abs(x - 45 - 0.15 * y)
    second = 36 - abs(y - 100 + 0.2 * x)
    cone = 34 - 0.9 * np.hypot(x - 110, y - 40)
    return np.maximum(np.maximum(first, second), np.maximum(cone, 0)) + waves(0.5, 17)(x, y)
