"""The command ``lidar-buildings explain``: why a building is as it is, or why there is none."""

from __future__ import annotations

import argparse

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.report.contents import contents_of
from lidar_buildings.report.explain.explanation import explain_building, explain_place, find_building
from lidar_buildings.report.page_file import write_page
from lidar_buildings.report.result_folder import ReportedBuilding, read_result


def explain_command(options: argparse.Namespace) -> int:
    """Print the explanation, and write the building's own page if that is wanted."""
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
