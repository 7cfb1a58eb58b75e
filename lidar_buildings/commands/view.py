"""The commands that show a result: ``report``, ``serve``, ``view`` and ``explain``."""

from __future__ import annotations

import argparse
from functools import cache, partial
from pathlib import Path

from lidar_buildings.report.view import ABOVE, NOTHING, OF_POINTS, OF_ROOFS, SIDES

_PICTURES = (".png", ".jpg")


def add_view_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is to be drawn, and where."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="output folder of a run")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write a PNG instead (needs no display)")
    for what, choices, default in (("roofs", OF_ROOFS, OF_ROOFS[0]), ("points", OF_POINTS, NOTHING)):
        parser.add_argument(
            f"--{what}",
            choices=(*choices, NOTHING),
            default=default,
            metavar="BY",
            help=f"colour {what} by {', '.join(choices)}, or show {NOTHING} (default: {default})",
        )
    parser.add_argument(
        "--from",
        dest="eye",
        choices=(*SIDES, ABOVE),
        default="southwest",
        metavar="SIDE",
        help=f"look from north, northeast … or {ABOVE} (default: southwest)",
    )


def view_command(options: argparse.Namespace) -> int:
    """Draw the result, and print where the picture is if one is wanted."""
    from lidar_buildings.core.model.errors import LidarBuildingsError, ParameterError
    from lidar_buildings.report.contents import contents_of
    from lidar_buildings.report.result_folder import read_result
    from lidar_buildings.report.view.drawing import open_window, write_picture
    from lidar_buildings.report.view.parts import parts_of

    if options.picture and options.picture.suffix.lower() not in _PICTURES:
        raise ParameterError(f"--picture {options.picture}: its name must end with {' or '.join(_PICTURES)}")
    contents = contents_of(read_result(options.folder))
    shown = (options.roofs, options.points)
    if not parts_of(contents, *shown):
        raise LidarBuildingsError(f"{options.folder}: contains nothing to draw: change --roofs or --points")
    if options.picture is None:
        open_window(cache(partial(parts_of, contents)), shown, options.eye)
        return 0
    write_picture(options.picture, parts_of(contents, *shown), options.eye)
    print(f"  {options.picture}")
    return 0


def report_command(options: argparse.Namespace) -> int:
    """Write the page of a result anew, and print where it is."""
    from lidar_buildings.report.page_file import write_report

    print(f"  {write_report(options.folder)}")
    return 0


def serve_command(options: argparse.Namespace) -> int:
    """Serve a result to browsers of this machine until interrupted."""
    from lidar_buildings.core.model.errors import ParameterError
    from lidar_buildings.report.server import result_server

    try:
        server = result_server(options.folder, options.port)
    except (OSError, OverflowError) as error:
        raise ParameterError(
            f"--port {options.port}: cannot be used ({error}): give another, or 0"
        ) from error
    with server:
        print(f"  http://127.0.0.1:{server.server_port}/   (Ctrl-C ends it)", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print()
    return 0


def explain_command(options: argparse.Namespace) -> int:
    """Print why a building is as it is, or why there is none, and write its own page if that is wanted."""
    from lidar_buildings.core.model.errors import ParameterError
    from lidar_buildings.report.contents import contents_of
    from lidar_buildings.report.explain.explanation import explain_building, explain_place, find_building
    from lidar_buildings.report.page_file import write_page
    from lidar_buildings.report.result_folder import ReportedBuilding, read_result

    result = read_result(options.folder)
    found = find_building(result, options.building)
    if not isinstance(found, ReportedBuilding):
        if options.page:
            raise ParameterError(f"--page: there is no building at {options.building}: remove --page")
        print(explain_place(result, found))
        return 0
    text = explain_building(result, found)
    print(text)
    if options.page:
        write_page(options.page, contents_of(result, found), explanation=text)
        print(f"\n  {options.page}")
    return 0
