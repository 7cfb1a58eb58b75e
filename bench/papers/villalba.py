"""Mancera-Taboada and others 2012: Table II, and the points of each class."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.common.clouds import read_tile
from bench.common.tables import percent, table
from bench.papers.presets import config_of
from lidar_buildings.core.model.classes import CLASS_NAMES, PointClass
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.plane_fitting.search import PROBABILITY, samples_needed
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points

#: Table II: unknowns → combinations for the shares of gross errors.
SHARES = (0.1, 0.2, 0.4, 0.6, 0.8, 0.9)
TABLE_II = {
    1: (2, 2, 4, 6, 14, 29),
    2: (2, 3, 7, 18, 74, 299),
    3: (3, 5, 13, 46, 373, 2995),
    4: (3, 6, 22, 116, 1871, 29956),
    5: (4, 8, 38, 292, 9361, 299572),
    6: (4, 10, 63, 730, 46807, 2995731),
    7: (5, 13, 106, 1827, 234041, 29957322),
    8: (6, 17, 177, 4570, 1170207, 299573226),
}
#: Section III: points of each class; the roads were parted from the terrain's 361,086.
COUNTS = {
    PointClass.GROUND: 361_086 - 185_430,
    PointClass.ROAD_SURFACE: 185_430,
    PointClass.LOW_VEGETATION: 50_543,
    PointClass.MEDIUM_VEGETATION: 331_291,
    PointClass.HIGH_VEGETATION: 746_932,
    PointClass.BUILDING: 402_055,
}
CLOUDS = ("delft", "fusa", "montpellier")


def report(data: Path, folder: Path | None) -> None:
    """Print the tables; draw the classes into a folder if one is given."""
    rows = [
        [
            f"U = {unknowns}",
            *(
                f"{n} / {samples_needed(PROBABILITY, s, unknowns)}"
                for s, n in zip(SHARES, paper, strict=True)
            ),
        ]
        for unknowns, paper in TABLE_II.items()
    ]
    print(f"Table II, P = {PROBABILITY:.0%}, paper / ours:")
    print(table(("", *(f"ε = {share}" for share in SHARES)), rows))
    tiles = {name: classified(data / name) for name in CLOUDS if any((data / name).glob("*.laz"))}
    total = sum(COUNTS.values())
    rows = [
        [
            CLASS_NAMES[one],
            f"{n:,}",
            percent(n / total),
            *(_share(t, one) for t in tiles.values()),
        ]
        for one, n in COUNTS.items()
    ]
    print("\nPoints by class; shares of these six [%], ground without roads:")
    print(table(("class", "paper", "paper %", *tiles), rows) + "\n")
    for name, tile in tiles.items() if folder is not None else ():
        _draw(folder / f"villalba_classes_{name}.png", tile)


def classified(folder: Path) -> PointTile:
    """Classify a cloud as published, without what its provider made of it."""
    config = config_of("villalba")
    tile = read_tile(folder)[0].with_columns(classification=None)
    return select_roof_points(filter_ground(tile, config.ground_filter).tile, config.roof_selection)


def _share(tile: PointTile, one: PointClass) -> str:
    of_these = np.isin(tile.classification, list(COUNTS))
    return percent(float((tile.classification[of_these] == one).mean()))


def _draw(path: Path, tile: PointTile) -> None:
    from bench.common.plotting import plt

    colours = dict(zip(COUNTS, ("#c8b48c", "black", "#c0e8a8", "#68b858", "#1c7030", "purple"), strict=True))
    figure, axes = plt.subplots(figsize=(12, 12))
    for one, colour in colours.items():
        mine = tile.points[tile.classification == one]
        axes.plot(mine[:, 0], mine[:, 1], ",", color=colour)
    axes.set(aspect="equal", title="ground, road (black), vegetation (green), building (purple)")
    figure.savefig(path, dpi=80, bbox_inches="tight")
    plt.close(figure)
