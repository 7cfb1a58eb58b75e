"""
Walls of a real drive against lines drawn by eye (`drive/walls.geojson`).

    python -m bench.street.drive [--data DIR] [--result FILE [--layer street_lines]] [--pictures DIR]

Found: share of the length of façades with at least 30 points a metre within 0.2 m of a line that is called
seen. Wrong: share of the length of these lines within 0.3 m of a vehicle, fence, hedge or other object and of
no façade. Without a result the stage `core/stages/facades` is run on the placed points, after the ground
filter.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import shapely

from bench.common.arguments import add_pictures, data_parser, picture_folder
from bench.common.clouds import data_folder, read_files
from bench.common.plotting import plt
from bench.common.tables import table
from bench.street.lines import offsets_to, places_along, share_within
from bench.street.walls import Lines, facade_lines, read_lines
from lidar_buildings.core.model.classes import PointClass, View
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.bags.placed_cloud import write_placed
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.tile_stages import filter_ground

#: Façades count from so many points a metre; a line finds one within this, is of an object within that [m].
MIN_POINTS, FOUND, NEAR = 30.0, 0.2, 0.3
#: What is a façade, what may be one, and what is none; all other kinds are objects.
FACADE, MAYBE = "facade", "unsure_facade"
HEADINGS = ("layer", "façades [m]", "found", "lines [m]", "assumed [m]", "near objects", "near nothing")
_COLOURS = {FACADE: "black", MAYBE: "0.6", "vehicle": "tab:red"}


class Drawn(NamedTuple):
    """Lines drawn by eye [m]."""

    facades: list[shapely.Geometry]  #: with enough points
    walls: list[shapely.Geometry]  #: all that are or may be façades
    objects: list[shapely.Geometry]
    kinds: list[tuple[str, shapely.Geometry]]  #: all of them


def read_drawn(path: Path) -> Drawn:
    """Read the lines of a drive."""
    drawn = Drawn([], [], [], [])
    for feature in json.loads(path.read_text(encoding="utf-8"))["features"]:
        line = shapely.LineString(feature["geometry"]["coordinates"])
        kind = feature["properties"]["kind"]
        drawn.kinds.append((kind, line))
        (drawn.walls if kind in (FACADE, MAYBE) else drawn.objects).append(line)
        if kind == FACADE and feature["properties"]["points_per_m"] >= MIN_POINTS:
            drawn.facades.append(line)
    return drawn


def placed_tile(bag: Path) -> PointTile:
    """Place the scans of a bag in its own frame."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "placed.laz"
        write_placed(bag, path, BagConfig(), ScanConfig())
        tile, frame = read_files([path])
    points = frame.to_source(tile.points)
    view = np.full(len(points), View.STREET, dtype=np.uint8)
    return PointTile(
        points=points, intensity=tile.intensity, view=view, point_spacing=measure_spacing(points)
    )


def lines_of(bag: Path) -> Lines:
    """Find façades in a bag's points."""
    from lidar_buildings.core.stages.facades.finding import find_facades

    tile = filter_ground(placed_tile(bag), PipelineConfig().ground_filter).tile
    return facade_lines(
        find_facades(tile.points, tile.height_above_ground, tile.classification == PointClass.GROUND)
    )


def cells(name: str, drawn: Drawn, lines: Lines) -> list[str]:
    """Return the figures in the order of `HEADINGS`."""
    facades, own = places_along(drawn.facades), places_along(lines.seen)
    found = share_within(facades, offsets_to(facades, lines.seen, FOUND, max_turn_deg=90.0), FOUND)
    of_walls = offsets_to(own, drawn.walls, NEAR, max_turn_deg=90.0) <= NEAR
    of_objects = offsets_to(own, drawn.objects, NEAR, max_turn_deg=90.0) <= NEAR
    total = max(own.total, 1e-9)
    wrong = own.length[of_objects & ~of_walls].sum() / total
    nothing = own.length[~of_objects & ~of_walls].sum() / total
    lengths = facades.total, own.total, places_along(lines.assumed).total
    return [
        *(name, f"{lengths[0]:.0f}", f"{found:.3f}", f"{lengths[1]:.0f}", f"{lengths[2]:.0f}"),
        *(f"{wrong:.3f}", f"{nothing:.3f}"),
    ]


def draw(drawn: Drawn, lines: Lines, points: np.ndarray | None = None) -> plt.Figure:
    """Draw façades (black), objects (red and orange) and lines called seen (blue) over the points."""
    figure, axes = plt.subplots(figsize=(22, 16), dpi=80, layout="constrained")
    if points is not None:
        axes.plot(*points[::3, :2].T, ",", color="0.8")
    for kind, line in drawn.kinds:
        axes.plot(*shapely.get_coordinates(line).T, color=_COLOURS.get(kind, "tab:orange"), linewidth=2.5)
    for geometry in lines.seen:
        for part in shapely.get_parts(geometry):
            axes.plot(*shapely.get_coordinates(part).T, color="tab:blue", linewidth=1.2)
    axes.set_aspect("equal")
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Print how much of the façades is found, and how much of what is found is none."""
    parser: argparse.ArgumentParser = data_parser(__doc__)
    parser.add_argument("--result", type=Path, metavar="FILE", help="GeoPackage of a run on the bag")
    parser.add_argument("--layer", default="street_lines")
    add_pictures(parser)
    options = parser.parse_args(arguments)
    folder, pictures = data_folder(options.data) / "drive", picture_folder(options.pictures)
    drawn = read_drawn(folder / "walls.geojson")
    lines = read_lines(options.result, options.layer) if options.result else lines_of(folder)
    name = options.layer if options.result else "facades"
    print(table(HEADINGS, [cells(name, drawn, lines)]))
    if pictures:
        draw(drawn, lines, placed_tile(folder).points).savefig(pictures / "drive.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
