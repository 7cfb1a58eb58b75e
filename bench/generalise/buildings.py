"""Building points on disturbed clouds and scenes: F1 against the providers' class 6, the map, exact truth."""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.arguments import settings_of
from bench.common.clouds import COLUMNS, read_files
from bench.common.tables import table
from bench.generalise.disturbances import disturbances
from bench.generalise.figures import FIGURE_HEADINGS, Score, rows_of
from bench.roofs.methods import METHODS, point_score, roof_mask
from bench.roofs.scenes import made
from bench.scenes.roofs import ROOF_SCENES
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.evaluation.readers.metric_polygons import read_metric_polygons
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points

#: Folders that are one cloud each; of `sparse`, each file. In `ctview` lie the tiles of `montpellier`.
FOLDERS = ("delft", "montpellier", "fusa", "lowdensity", "stbarth", "amsterdam")
#: Least points per square metre, and share of buildings among them, of a disturbed cloud that is judged.
MIN_DENSITY, MIN_BUILDING = 0.2, 0.02
#: How scenes are made anew: other houses of the kind, sparser, denser, with other noise, turned.
SCENES: dict[str, dict[str, Any]] = {
    "plain": {},
    "other": {"seed": 1},
    "half": {"density_factor": 0.5},
    "quarter": {"density_factor": 0.25},
    "triple": {"density_factor": 3.0},
    "noisy": {"noise": 0.03},
    "noise of 8 cm": {"noise": 0.08},
    "rotated": {"rotation_deg": 30.0, "seed": 1},
}


class Labelled(NamedTuple):
    """A cloud with heights above its own ground, and which points are building and are judged."""

    tile: PointTile
    is_building: NDArray[np.bool_]
    is_judged: NDArray[np.bool_]


def read_cloud(paths: list[Path]) -> Labelled:
    """
    Read files as one cloud, its buildings class 6.

    Beside a map, only points on which class and map agree are judged: eaves and awnings are not.
    """
    tile, frame = read_files(paths)
    is_building = tile.classification == PointClass.BUILDING
    is_judged = np.ones(len(is_building), dtype=bool)
    if (paths[0].parent / "blocks_nw.gpkg").is_file():
        layers = [paths[0].parent / f"{name}_nw.gpkg" for name in ("blocks", "aoi")]
        blocks, area = (shapely.union_all(read_metric_polygons(layer).polygons) for layer in layers)
        shapely.prepare([blocks, area])
        x, y = tile.points[:, :2].T.astype(np.float64) + np.array(frame.origin[:2])[:, None]
        is_judged = shapely.contains_xy(area, x, y) & (shapely.contains_xy(blocks, x, y) == is_building)
    return Labelled(tile, is_building, is_judged)


def read_clouds(data: Path) -> Iterator[tuple[str, Labelled]]:
    """Yield the clouds that are there."""
    for name in FOLDERS:
        if paths := sorted((data / name).glob("*.laz")):
            yield name, read_cloud(paths)
    for path in sorted((data / "sparse").glob("*.laz")):
        yield path.stem, read_cloud([path])


def versions(data: Path, quick: bool, seed: int) -> Iterator[tuple[str, str, Labelled]]:
    """Yield every cloud plain and disturbed, with its name and kind; grounds are found anew for each."""
    for name, cloud in read_clouds(data):
        points = cloud.tile.points.astype(np.float64)
        columns = {key: getattr(cloud.tile, key) for key in COLUMNS if key != "classification"}
        columns = {key: column for key, column in columns.items() if column is not None}
        plain = filter_ground(replace(cloud.tile, classification=None), GroundFilterConfig()).tile
        yield name, "plain", cloud._replace(tile=plain)
        for one in disturbances(points, columns, quick=quick, seed=zlib.crc32(name.encode()) + seed):
            is_building, is_judged = cloud.is_building[one.rows], cloud.is_judged[one.rows]
            extent = np.ptp(one.points[:, :2], axis=0)
            is_dense = len(one.points) >= MIN_DENSITY * np.prod(extent)
            if is_dense and np.mean(is_building & is_judged) >= MIN_BUILDING:
                tile = filter_ground(PointTile(points=one.points, **one.columns), GroundFilterConfig()).tile
                yield f"{name} {one.name}", one.kind, Labelled(tile, is_building, is_judged)


def cloud_scores(
    data: Path, configs: Mapping[str, RoofSelectionConfig], options: argparse.Namespace
) -> dict[str, list[Score]]:
    """Return the F1 of each method on each version of each cloud, façades included."""
    scores: dict[str, list[Score]] = {method: [] for method in configs}
    for case, kind, (tile, is_building, is_judged) in versions(data, options.quick, options.seed):
        for method, config in configs.items():
            mask = select_roof_points(tile, config).classification == PointClass.BUILDING
            scores[method].append(Score(case, kind, point_score(mask, is_building, is_judged).f1))
    return scores


def scene_scores(method: str, settings: Mapping[str, Any]) -> list[Score]:
    """Return the F1 of a method's roofs, without façades, on every scene made anew."""
    scores = []
    for kind, arguments in SCENES.items():
        for name in ROOF_SCENES:
            scene = made(name, **arguments)
            mask = roof_mask(scene.points, scene.columns, method, settings, with_facades=False)
            value = point_score(mask, scene.is_building, scene.is_judged).f1
            scores.append(Score(f"{name} {kind}", kind, value))
    return scores


def report(data: Path, options: argparse.Namespace) -> str:
    """Return the table of this part."""
    settings = settings_of(options.set, "roof_selection")
    methods = options.methods or METHODS[:1]
    configs = {method: RoofSelectionConfig(**{**settings, "method": method}) for method in methods}
    rows: list[list[str]] = []
    for method, scores in cloud_scores(data, configs, options).items():
        rows += rows_of(f"{method}, clouds", scores, higher_is_better=True)
        rows += rows_of(f"{method}, scenes", scene_scores(method, settings), higher_is_better=True)
    return table(("method", "F1", *FIGURE_HEADINGS), rows)
