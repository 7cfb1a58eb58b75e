"""What ``lidar-buildings run`` can be told, and shares with other commands."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

#: What a request is made of as well, where a command cannot be told it.
UNTOLD: dict[str, Any] = {
    **dict.fromkeys(("output", "update", "tile_size", "bounds", "crs", "namespace", "record", "rate")),
    **dict.fromkeys(("footprints", "footprints_layer", "footprint_id")),
    **dict.fromkeys(("topic", "odometry", "start", "duration")),
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
            parser.error(f"{option} {values}: {before} is given already, and one topic of a kind is read")
        setattr(namespace, self.dest, values)


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all of `run`."""
    parser.add_argument(
        "input",
        nargs="+",
        metavar="INPUT",
        help="LAS, LAZ or COPC files, folders or globs, also as URLs (https://, s3://); bags of ROS 2 or 1",
    )
    folder = parser.add_mutually_exclusive_group(required=True)
    folder.add_argument("--output", type=Path, metavar="DIR", help="folder for the results")
    folder.add_argument(
        "--update",
        type=Path,
        metavar="DIR",
        help="… that is kept up to date, without ROS: only tiles whose points have changed are done",
    )
    parser.add_argument(
        "--topic", metavar="NAME", action=Once, help="bags: topic of the scans (default: the only one)"
    )
    parser.add_argument(
        "--odometry",
        metavar="NAME",
        action=Once,
        help="bags: topic of the poses (default: the only one; else /tf)",
    )
    add_part_of_bag(parser)
    parser.add_argument(
        "--georeferenced", action="store_true", help="bags: the scans are in the map already, without poses"
    )
    parser.add_argument(
        "--rate", type=float, metavar="R", help="play at R times the recorded speed (default: at once)"
    )
    add_record(parser)
    add_settings(parser)
    parser.add_argument("--tile-size", type=float, metavar="M", help="side of a tile [m]")
    add_bounds(parser)
    parser.add_argument(
        "--crs", metavar="EPSG:N", help="reference system of inputs that name none (3D Tiles need one)"
    )
    parser.add_argument(
        "--footprints",
        type=Path,
        metavar="FILE",
        help="take the polygons of this file (GeoPackage, Shapefile, GeoJSON …) instead of traced outlines",
    )
    parser.add_argument(
        "--footprints-layer", metavar="NAME", help="the file's layer, where it has several of polygons"
    )
    parser.add_argument(
        "--footprint-id",
        metavar="COLUMN",
        help="column that names a footprint in the results (default: one that looks like it)",
    )
    parser.add_argument("--no-ros", action="store_true", help="call the stages directly, without ROS")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=at_least_one,
        default=0,
        metavar="N",
        help="without ROS, on N processes of dask.distributed",
    )
    where.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="… on the workers of a dask scheduler (tcp://…:8786)",
    )
    before = parser.add_mutually_exclusive_group()
    before.add_argument("--overwrite", action="store_true", help="replace what is in DIR")
    before.add_argument(
        "--retry-failed", action="store_true", help="do the tiles again that failed in DIR, without ROS"
    )
    parser.add_argument(
        "--namespace", metavar="NAME", help="ROS namespace of the nodes (default: one of its own)"
    )
    words = parser.add_mutually_exclusive_group()
    words.add_argument("--quiet", action="store_true", help="print nothing but what went wrong")
    words.add_argument("--json", action="store_true", help="print the outcome as JSON, for scripts")


def add_record(parser: argparse.ArgumentParser) -> None:
    """Add what of the graph is recorded."""
    parser.add_argument(
        "--record", metavar="BAG", help="record topics of the graph in a bag (MCAP), a folder to be made"
    )


def add_part_of_bag(parser: argparse.ArgumentParser) -> None:
    """Add which time of a bag is wanted."""
    parser.add_argument(
        "--start", type=float, metavar="S", help="bags: begin so many seconds after their start"
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="bags: read so many seconds (default: all)"
    )


def add_plan_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all of `plan`: of what `run` can be told, what its cost depends on."""
    parser.add_argument(
        "input", nargs="+", metavar="INPUT", help="LAS, LAZ or COPC files, folders or globs, also as URLs"
    )
    parser.add_argument(
        "--workers", type=at_least_one, default=0, metavar="N", help="on N processes of dask.distributed"
    )
    parser.add_argument("--no-ros", action="store_true", help="without ROS, on the cores of this machine")
    add_settings(parser)
    parser.add_argument("--tile-size", type=float, metavar="M", help="side of a tile [m]")
    add_bounds(parser)
    parser.add_argument("--json", action="store_true", help="print JSON, for scripts")
    parser.set_defaults(**UNTOLD)


def add_bounds(parser: argparse.ArgumentParser) -> None:
    """Add which part of the inputs is wanted."""
    parser.add_argument(
        "--bounds",
        type=float,
        nargs=4,
        metavar=("WEST", "SOUTH", "EAST", "NORTH"),
        help="only the points in these, in the coordinates of the inputs; of COPC little else is read",
    )


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add how parameters are set, and the last stage."""
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="parameters as in config/pipeline.param.yaml"
    )
    parser.add_argument(
        "--preset",
        metavar="NAME",
        help="the whole chain as a paper has it: santos, villalba or sampath_shan; --params and --set win",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="STAGE.NAME=VALUE",
        help="set one parameter (repeatable)",
    )
    parser.add_argument("--until", metavar="STAGE", help="end with this stage")


def at_least_one(text: str) -> int:
    """Return a number of workers."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return number
