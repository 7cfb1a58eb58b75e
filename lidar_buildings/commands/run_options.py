"""What ``lidar-buildings run`` can be told, and shares with other commands."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

#: What a request is made of as well, where a command cannot be told it.
UNTOLD: dict[str, Any] = {
    **dict.fromkeys(("output", "update", "tile_size", "bounds", "crs", "namespace", "record", "rate")),
    **dict.fromkeys(("footprints", "footprints_layer", "footprint_id")),
    **dict.fromkeys(("attributes", "geoid")),
    **dict.fromkeys(("topic", "odometry", "start", "duration", "offset", "align")),
    **dict.fromkeys(("georeferenced", "no_ros", "quiet", "json", "overwrite", "retry_failed"), False),
    "input": (),
    "scheduler": "",
}


class Once(argparse.Action):
    """An option that may be given once, where argparse would take the last one without a word."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option: str | None = None,
    ) -> None:
        """Take its value."""
        if (before := getattr(namespace, self.dest, None)) is not None:
            parser.error(f"{option} {values}: {before} was already given; only one topic can be read")
        setattr(namespace, self.dest, values)


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all of `run`."""
    parser.add_argument(
        "input",
        nargs="+",
        metavar="INPUT",
        help="LAS, LAZ or COPC files, folders or globs, also as URLs (https://, s3://); ROS 2 or ROS 1 bags",
    )
    _add_results(parser.add_argument_group("results"))
    _add_parameters_of_run(parser.add_argument_group("parameters"))
    bags = parser.add_argument_group("bags")
    add = bags.add_argument
    add("--topic", metavar="NAME", action=Once, help="topic of the scans (default: the only one)")
    add("--odometry", metavar="NAME", action=Once, help="topic of poses (default: the only one; else /tf)")
    add_part_of_bag(bags)
    add(
        "--georeferenced",
        action="store_true",
        help="the scans are already in map coordinates; no poses are needed",
    )
    add(
        "--offset",
        metavar="X,Y,Z,YAW",
        help="beside files: where the bag's frame lies in their coordinate reference system [m, deg]",
    )
    add(
        "--align",
        action="store_const",
        const=True,
        help="beside files: lay the bag on their ground, roofs and walls",
    )
    add(
        "--rate",
        type=float,
        metavar="R",
        help="play at R times the recorded speed (default: as fast as possible)",
    )
    _add_places(parser.add_argument_group("where it runs"))


def _add_results(group: Any) -> None:
    add = group.add_argument
    folder = group.add_mutually_exclusive_group(required=True)
    folder.add_argument("--output", type=Path, metavar="DIR", help="folder for the results")
    folder.add_argument(
        "--update",
        type=Path,
        metavar="DIR",
        help="… to keep up to date, without ROS: only tiles whose points changed are processed",
    )
    before = group.add_mutually_exclusive_group()
    before.add_argument("--overwrite", action="store_true", help="replace the contents of DIR")
    before.add_argument(
        "--retry-failed", action="store_true", help="reprocess the failed tiles in DIR, without ROS"
    )
    add("--attributes", metavar="NAMES", help="3dbag: also write attributes under the names of 3DBAG (b3_…)")
    add(
        "--geoid",
        metavar="GRID",
        help="3D Tiles: grid of the heights of the geoid (GeoTIFF, GTX), or one height [m], if PROJ has none",
    )
    add(
        "--strict",
        action="store_true",
        help="end with exit status 4 if the quality of a building is not good",
    )
    words = group.add_mutually_exclusive_group()
    words.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    words.add_argument("--json", action="store_true", help="print the outcome as JSON, for scripts")


def _add_parameters_of_run(group: Any) -> None:
    add = group.add_argument
    add_settings(group)
    add("--tile-size", type=float, metavar="M", help="side of a tile [m]")
    add_bounds(group)
    add(
        "--crs",
        metavar="EPSG:N",
        help="coordinate reference system of inputs without one (3D Tiles need one)",
    )
    add(
        "--footprints",
        type=Path,
        metavar="FILE",
        help="use the polygons of this file (GeoPackage, Shapefile, GeoJSON …) instead of traced outlines",
    )
    add("--footprints-layer", metavar="NAME", help="polygon layer to use, if the file has several")
    add(
        "--footprint-id", metavar="COLUMN", help="column with the footprint ids (default: chosen by its name)"
    )


def _add_places(group: Any) -> None:
    add = group.add_argument
    add("--no-ros", action="store_true", help="call the stages directly, without ROS")
    where = group.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=at_least_one,
        default=0,
        metavar="N",
        help="without ROS, on N dask.distributed processes",
    )
    where.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="… on the workers of a dask scheduler (tcp://…:8786)",
    )
    add("--namespace", metavar="NAME", help="ROS namespace of the nodes (default: a unique one)")
    add_record(group)


def add_record(parser: Any) -> None:
    """Add what of the graph is recorded."""
    parser.add_argument("--record", metavar="BAG", help="record topics of the graph to a new bag (MCAP)")


def add_part_of_bag(parser: Any) -> None:
    """Add which time of a bag is wanted."""
    add = parser.add_argument
    add("--start", type=float, metavar="S", help="of a bag: skip the first S seconds")
    add("--duration", type=float, metavar="S", help="of a bag: read S seconds (default: all)")


def add_plan_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all of `plan`: of what `run` can be told, what its cost depends on."""
    add = parser.add_argument
    add("input", nargs="+", metavar="INPUT", help="LAS, LAZ or COPC files, folders or globs, also as URLs")
    add("--workers", type=at_least_one, default=0, metavar="N", help="with N dask.distributed processes")
    add("--no-ros", action="store_true", help="without ROS, on the cores of this machine")
    add_settings(parser)
    add("--tile-size", type=float, metavar="M", help="side of a tile [m]")
    add_bounds(parser)
    add("--json", action="store_true", help="print JSON, for scripts")
    parser.set_defaults(**UNTOLD)


def add_bounds(parser: Any) -> None:
    """Add which part of the inputs is wanted."""
    parser.add_argument(
        "--bounds",
        type=float,
        nargs=4,
        metavar=("WEST", "SOUTH", "EAST", "NORTH"),
        help="use only points within these bounds, in input coordinates; COPC files are read only there",
    )


def add_settings(parser: Any) -> None:
    """Add how parameters are set, and the last stage."""
    add = parser.add_argument
    add("--params", type=Path, metavar="FILE", help="parameters as in config/pipeline.param.yaml")
    add(
        "--preset",
        metavar="NAME",
        help="parameters of a published method: santos, villalba or sampath_shan; --params and --set win",
    )
    add(
        "--set",
        action="append",
        default=[],
        metavar="STAGE.NAME=VALUE",
        help="set one parameter (repeatable)",
    )
    add("--until", metavar="STAGE", help="stop after this stage")


def at_least_one(text: str) -> int:
    """Return a number of workers."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return number
