"""Mancera-Taboada and others 2012: Table II, its ground filter, points of each class, greys of roads."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.common.clouds import read_tile
from bench.common.tables import percent, table
from bench.ground.isprs import read_samples
from bench.ground.scores import cells_of, mean_cells, score_of
from bench.papers.presets import config_of
from lidar_buildings.core.model.classes import CLASS_NAMES, PointClass
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.plane_fitting.search import PROBABILITY, samples_needed
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.roads import find_roads, point_brightness
from lidar_buildings.core.stages.roof_selection.selection import last_and_only_returns
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
#: Section III: mean grey values of roads and of other ground.
GREYS = ("55", "148")
#: Even planes without objects: slopes (rise over run), side and noise [m], and the paper's density.
SLOPES, SIDE, NOISE, DENSITY, SEEDS = (0.0, 0.02, 0.05, 0.1, 0.3), 200.0, 0.05, 1.9, range(2)


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
    print("\nTerrain of even planes that is found [%], and errors on the ISPRS samples:")
    print(table(("plane", *(f"{slope:.0%}" for slope in SLOPES)), [["found", *map(percent, plane_shares())]]))
    print(table(("sample", "total", "type I", "type II", "kappa"), _sample_rows(data / "isprs")))
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
    print("Mean greys of the ground that is road and of the rest, and what share of the ground is road [%]:")
    headings = ("cloud", "as recorded", "", "by strip, 0 to 255", "", "road", "areas, by strip", "", "road")
    rows = [["paper", *GREYS, *GREYS, percent(185_430 / 361_086), "", "", ""]]
    print(table(headings, [*rows, *([name, *grey_cells(tile)] for name, tile in tiles.items())]) + "\n")
    for name, tile in tiles.items() if folder is not None else ():
        _draw(folder / f"villalba_classes_{name}.png", tile)


def plane_shares() -> list[float]:
    """Return which share of even planes the filter takes for terrain, slope by slope."""
    found = []
    for slope in SLOPES:
        shares = []
        for seed in SEEDS:
            random = np.random.default_rng(seed)
            xy = random.uniform(0.0, SIDE, (int(DENSITY * SIDE**2), 2))
            z = slope * xy[:, 0] + random.normal(0.0, NOISE, len(xy))
            tile = PointTile(np.column_stack((xy, z)))
            classes = filter_ground(tile, config_of("villalba").ground_filter).tile.classification
            shares.append(float((classes == PointClass.GROUND).mean()))
        found.append(float(np.mean(shares)))
    return found


def _sample_rows(folder: Path) -> list[list[str]]:
    if not folder.is_dir():
        return []
    settings = asdict(config_of("villalba").ground_filter)
    scores = {name: score_of(one, "histogram_tin", settings) for name, one in read_samples(folder).items()}
    rows = [[name, *cells_of(score)] for name, score in scores.items()]
    return [*rows, ["mean", *mean_cells(list(scores.values()))]]


def grey_cells(tile: PointTile) -> list[str]:
    """Return mean greys of road and other ground: as recorded, by strip, and by strip of roads by areas."""
    is_ground = np.isin(tile.classification, (PointClass.GROUND, PointClass.ROAD_SURFACE))
    ground = tile.select(np.flatnonzero(is_ground))
    _, is_only = last_and_only_returns(ground.points, ground.return_number, ground.number_of_returns)
    strip = ground.point_source_id
    grey = point_brightness(len(ground), ground.intensity, ground.normalised_intensity, strip, is_only)
    limits = config_of("villalba").roof_selection
    spacing = measure_spacing(ground.points) if ground.point_spacing is None else ground.point_spacing
    by_areas = find_roads(ground.points, grey, is_only, spacing, RoofSelectionConfig())
    cells = []
    for values, road in (
        (ground.intensity, _between(ground.intensity, limits)),
        (grey, _between(grey, limits)),
        (grey, by_areas),
    ):
        cells += [f"{values[some].mean():.0f}" if some.any() else "–" for some in (road, ~road)]
        cells.append(percent(float(road.mean())))
    return cells[:2] + cells[3:]


def _between(grey: NDArray[np.float32], limits: RoofSelectionConfig) -> NDArray[np.bool_]:
    return (grey >= limits.min_road_intensity) & (grey <= limits.max_road_intensity)


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
