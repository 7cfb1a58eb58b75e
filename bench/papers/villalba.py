"""Mancera-Taboada and others 2012: Table II, the points and grey values of each class, the ground filter."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.common.clouds import Cloud, read_tile
from bench.common.tables import percent
from bench.ground.isprs import read_samples
from bench.ground.methods import METHODS, ground_mask
from bench.ground.scores import score_of_mask
from bench.papers.pages import Section, markdown
from bench.papers.presets import config_of
from bench.scenes.kit import scan_rows
from lidar_buildings.core.model.classes import CLASS_NAMES, PointClass
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.plane_fitting.search import PROBABILITY, samples_needed
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.roads import find_roads, point_brightness
from lidar_buildings.core.stages.roof_selection.selection import last_and_only_returns
from lidar_buildings.evaluation.scores.cells import Confusion
from lidar_buildings.pipeline.config import PipelineConfig
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
#: Section III: mean grey values of roads and of the rest of the ground, of 255.
GREYS = ("55.26", "148.13")
#: Clouds with intensity.
CLOUDS = ("delft", "fusa", "montpellier", "toronto")
#: The ground filter's parameters as published (section III), and with fixed limits.
AS_PUBLISHED = {"iteration_angle": 6.0, "iteration_distance": 1.4, "ground_distance": 0.12}
#: Slopes of even planes without objects, of 1.9 points/m² as in table III, and the noise of their points [m].
SLOPES, DENSITY, NOISE, SIDE = (0.0, 0.02, 0.05, 0.1), 1.9, 0.05, 150.0


def sections(data: Path, folder: Path | None) -> Iterator[Section]:
    """Measure one table after the other; draw the figures into a folder if one is given."""
    yield Section("table-2", _table_2())
    there = [name for name in CLOUDS if any((data / name).glob("*.laz"))]
    clouds = {name: read_tile(data / name)[0] for name in there}
    variants = {"as published": config_of("villalba"), "default": PipelineConfig()}
    tiles = {
        (name, variant): classified(tile, config)
        for name, tile in clouds.items()
        for variant, config in variants.items()
    }
    yield Section("classes", _classes(tiles))
    yield Section("greys", _greys(tiles))
    yield Section("buildings", _buildings(clouds, tiles))
    yield Section("ground", _ground(data))
    if folder is not None:
        for (name, variant), tile in tiles.items():
            _draw(folder / f"villalba_figures_3_to_6_{name}_{variant.replace(' ', '_')}.png", tile)


def classified(tile: PointTile, config: PipelineConfig) -> PointTile:
    """Classify a cloud without what its provider made of it."""
    bare = tile.with_columns(classification=None)
    return select_roof_points(filter_ground(bare, config.ground_filter).tile, config.roof_selection)


def _table_2() -> str:
    rows = []
    for unknowns, paper in TABLE_II.items():
        ours = [samples_needed(PROBABILITY, share, unknowns) for share in SHARES]
        cells = [f"{theirs} / {own}" for theirs, own in zip(paper, ours, strict=True)]
        rows.append([f"U = {unknowns}", *cells])
    headings = ("paper / ours", *(f"ε = {share}" for share in SHARES))
    return markdown(headings, rows)


def _classes(tiles: dict[tuple[str, str], PointTile]) -> str:
    """Return the shares of the paper's six classes."""
    total = sum(COUNTS.values())
    rows = [
        [CLASS_NAMES[one], f"{n:,}", percent(n / total), *(_share(tile, one) for tile in tiles.values())]
        for one, n in COUNTS.items()
    ]
    headings = ("class", "paper", "paper [%]", *(f"{name}, {variant}" for name, variant in tiles))
    return markdown(headings, rows) + "\n\nShares of these six classes [%]; ground is without roads."


def _share(tile: PointTile, one: PointClass) -> str:
    of_these = np.isin(tile.classification, list(COUNTS))
    return percent(float((tile.classification[of_these] == one).mean()))


def _greys(tiles: dict[tuple[str, str], PointTile]) -> str:
    """Return mean greys of the ground that is road and of the rest, and what share of the ground is road."""
    rows = [["paper", *GREYS, *GREYS, percent(185_430 / 361_086), "", "", ""]]
    rows += [
        [name, *grey_cells(tile)]
        for (name, variant), tile in tiles.items()
        if variant == "as published" and tile.intensity is not None
    ]
    headings = (
        *(
            "cloud",
            "road, as recorded",
            "other ground",
            "road, by strip, 0 to 255",
            "other ground",
            "road [%]",
        ),
        *("road, areas by strip (default)", "other ground", "road [%]"),
    )
    return markdown(headings, rows) + "\n\nMeans of the grey values 40 to 100, and of roads by areas."


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


def _buildings(clouds: dict[str, PointTile], tiles: dict[tuple[str, str], PointTile]) -> str:
    """Return what becomes of the provider's buildings: the paper lost edges and roofs to high vegetation."""
    rows = []
    for (name, variant), tile in tiles.items():
        given = clouds[name].classification
        if given is None or not (given == PointClass.BUILDING).any():
            continue
        true, found = given == PointClass.BUILDING, tile.classification
        green = (PointClass.LOW_VEGETATION, PointClass.MEDIUM_VEGETATION, PointClass.HIGH_VEGETATION)
        shares = [
            (found[true] == PointClass.BUILDING).mean(),
            np.isin(found[true], green).mean(),
            true[found == PointClass.BUILDING].mean(),
        ]
        rows.append([f"{name}, {variant}", *(percent(float(share)) for share in shares)])
    headings = ("data", "building [%]", "vegetation [%]", "of the buildings found are the provider's [%]")
    return markdown(headings, rows)


def _ground(data: Path) -> str:
    """Return the ground filter's errors on the ISPRS samples and on even planes, and those of its parts."""
    samples = read_samples(data / "isprs")
    settings = {
        "as published": ("histogram_tin", AS_PUBLISHED),
        "6° and 1.4 m held throughout": ("progressive_tin", AS_PUBLISHED),
        "default": (METHODS[0], {}),
    }
    scores = {
        name: [score_of_mask(ground_mask(one, *setting), one.is_ground) for one in samples.values()]
        for name, setting in settings.items()
    }
    rows = [
        [name, *(percent(found[k].total_error) for found in scores.values())]
        for k, name in enumerate(samples)
    ]
    for name, mean in (("mean", np.mean), ("median", np.median)):
        rows.append([name, *(percent(float(mean([s.total_error for s in f]))) for f in scores.values())])
    for name, member in (("type I, mean", "type_1_error"), ("type II, mean", "type_2_error")):
        cells = [percent(float(np.mean([getattr(s, member) for s in f]))) for f in scores.values()]
        rows.append([name, *cells])
    for slope in SLOPES:
        plane = even_plane(slope)
        found = [_kept(ground_mask(plane, *setting), plane) for setting in settings.values()]
        rows.append([f"even plane, slope {slope:.0%}: type I", *map(percent, found)])
    return markdown(("total error [%]", *settings), rows)


def even_plane(slope: float) -> Cloud:
    """Return terrain without objects."""
    random = np.random.default_rng(0)
    xy = scan_rows(np.zeros(2), np.full(2, SIDE), DENSITY, random)
    z = slope * xy[:, 0] + random.normal(0.0, NOISE, len(xy))
    return Cloud(np.column_stack((xy, z)), {}, np.ones(len(xy), dtype=np.bool_))


def _kept(mask: NDArray[np.bool_], cloud: Cloud) -> float:
    score: Confusion = score_of_mask(mask, cloud.is_ground)
    return float(score.type_1_error)


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
