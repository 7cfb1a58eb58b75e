"""
Building points on real clouds, from raw points, against a map and against the class that providers deliver.

    python -m bench.roofs.run [--data DIR] [--areas AREA ...] [--methods METHOD ...] [--set NAME=VALUE ...]
                          [--pictures DIR]

Delft against the base map BGT within the area in which it is complete, in cells of 0.5 m; Montpellier, fusa
and the sparse tiles against the provider's class 6, point by point. Each folder is read as one cloud; ground
and heights are those of this package's own filter, and the classes that come with the points are not looked
at. One set of parameters for all.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.arguments import add_pictures, parser_of, picture_folder, settings_of
from bench.common.clouds import data_folder, read_tile
from bench.common.tables import percent, table
from bench.roofs.methods import METHODS, groups_of, method_headings, point_score
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.evaluation.readers.metric_polygons import read_metric_polygons
from lidar_buildings.evaluation.scores.cells import (
    DEFAULT_CELL,
    CellSet,
    cell_centres,
    cells_inside,
    cells_of_points,
    cells_of_polygons,
    score_buildings,
)
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points

#: Headings of a method's columns; the third figure is IoU for cells and F1 for points, all in percent.
HEADINGS = ("recall", "precision", "IoU/F1", "s")


class Reference(NamedTuple):
    """What an area is judged by."""

    name: str  #: for the table
    is_building: NDArray[np.bool_]  #: the provider's buildings, shape (n_points,)
    #: The map's building cells, and the polygons within which they are complete; None without a map.
    cells: CellSet | None = None
    area: NDArray[Any] | None = None


def read_area(folder: Path) -> tuple[PointTile, Reference]:
    """Read a folder's cloud with heights above its own ground, and what it is judged by."""
    tile, frame = read_tile(folder)
    classes = tile.classification
    reference = Reference("class 6", classes == PointClass.BUILDING)
    if (folder / "blocks_nw.gpkg").is_file():
        layers = [read_metric_polygons(folder / f"{name}_nw.gpkg").polygons for name in ("blocks", "aoi")]
        blocks, area = (shapely.transform(layer, lambda xy: xy - frame.origin[:2]) for layer in layers)
        reference = reference._replace(
            name="BGT cells", cells=cells_of_polygons(blocks, DEFAULT_CELL), area=area
        )
    tile = replace(tile, classification=np.full(len(classes), PointClass.UNCLASSIFIED, dtype=np.uint8))
    return filter_ground(tile, GroundFilterConfig()).tile, reference


def cells_of(tile: PointTile, mask: NDArray[np.bool_], reference: Reference) -> list[str]:
    """Recall, precision and IoU of cells where there is a map, else recall, precision and F1 of points."""
    if reference.cells is None:
        score = point_score(mask, reference.is_building)
        return [percent(value) for value in (score.recall, score.precision, score.f1)]
    found = cells_of_points(tile.points, mask, DEFAULT_CELL)
    score = score_buildings(found, reference.cells, cell=DEFAULT_CELL, area=reference.area)
    return [percent(value) for value in (score.recall, score.precision, score.iou)]


def rows_of(
    folders: Mapping[str, Path],
    methods: Sequence[str],
    settings: Mapping[str, Any] | None = None,
    pictures: Path | None = None,
) -> list[list[str]]:
    """Lines of the table: every area, all methods side by side."""
    rows = []
    for name, folder in folders.items():
        tile, reference = read_area(folder)
        cells = []
        for method in methods:
            config = RoofSelectionConfig(**{**(settings or {}), "method": method})
            start = time.perf_counter()
            mask = select_roof_points(tile, config).classification == PointClass.BUILDING
            seconds = time.perf_counter() - start
            figures = cells_of(tile, mask, reference)
            cells += [*figures, f"{seconds:.1f}"]
            if pictures is not None:
                title = f"{name}, {method}: {' / '.join(figures)} %"
                _draw(pictures / f"{name}_{method}.png", tile, mask, reference, title)
        rows.append([name, reference.name, str(len(tile.points)), *cells])
    return rows


def _draw(path: Path, tile: PointTile, mask: NDArray[np.bool_], reference: Reference, title: str) -> None:
    """Draw one area's disagreements; matplotlib is needed only for this."""
    from bench.common.pictures import draw_over_relief

    if reference.cells is None:
        draw_over_relief(path, tile.points, groups_of(tile.points, mask, reference.is_building), title)
        return
    found, true = (
        cells_inside(cells, reference.area, DEFAULT_CELL)
        for cells in (cells_of_points(tile.points, mask, DEFAULT_CELL), reference.cells)
    )
    either = np.union1d(found, true)
    centres = cell_centres(either, DEFAULT_CELL)
    low, high = centres.min(axis=0), centres.max(axis=0)
    near = tile.points[((tile.points[:, :2] >= low) & (tile.points[:, :2] <= high)).all(axis=1)]
    groups = groups_of(centres, np.isin(either, found), np.isin(either, true))
    draw_over_relief(path, near, groups, title, DEFAULT_CELL)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    areas = ("delft", "montpellier", "fusa", "lowdensity")
    parser = parser_of(__doc__, METHODS)
    parser.add_argument("--areas", nargs="+", choices=areas, default=areas, metavar="AREA")
    add_pictures(parser)
    options = parser.parse_args(arguments)
    data = data_folder(options.data)
    folders = {name: data / name for name in options.areas if any((data / name).glob("*.laz"))}
    if not folders:
        raise SystemExit(
            f"{data}: holds none of {', '.join(options.areas)}: give the data folder with --data"
        )
    settings = settings_of(options.set, "roof_selection")
    pictures = picture_folder(options.pictures)
    rows = rows_of(folders, options.methods, settings, pictures)
    shorts = method_headings(options.methods)
    print(", ".join(f"{short} = {method}" for short, method in shorts.items()))
    print(table(("area", "reference", "points", *(f"{s} {h}" for s in shorts for h in HEADINGS)), rows))


if __name__ == "__main__":
    main()
