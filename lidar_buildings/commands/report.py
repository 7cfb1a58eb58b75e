"""The command ``lidar-buildings report``: the page of a result, made anew."""

from __future__ import annotations

import argparse

from lidar_buildings.report.page_file import write_report


def report_command(options: argparse.Namespace) -> int:
    """Write the page, and print where it is."""
    print(f"  {write_report(options.folder)}")
    return 0
