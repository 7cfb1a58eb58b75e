"""Bags among the inputs of a run: their scans are placed first, and then read like any other cloud."""

from __future__ import annotations

import sys
from dataclasses import asdict, replace

from lidar_buildings.commands.run_request import RunRequest
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.io.bags.bag_inputs import bags_among, place_bags, with_clouds
from lidar_buildings.io.results.run_folder import PARTIAL, PLACED, check_folder


def with_placed_bags(request: RunRequest) -> RunRequest:
    """
    Return the request with a LAZ file for each bag.

    The files stand among the unfinished tiles of the output folder, and go with them; an interrupted run goes
    on with those that are there.

    Raises
    ------
    ParameterError
        If something is said of bags and no input is one.
    InputError, OutputError
        If a bag cannot be read or placed, or the output folder not used.
    """
    if not bags_among(request.inputs):
        told = {**asdict(request.choice), "georeferenced": request.scans.georeferenced}
        if given := [f"--{name}" for name, value in told.items() if value]:
            raise ParameterError(f"{', '.join(given)}: says what of a bag is wanted, and no INPUT is one")
        return request
    check_folder(request.output, overwrite=request.overwrite)
    folder = request.output / PARTIAL / PLACED
    records = place_bags(
        request.inputs,
        folder,
        request.choice,
        request.scans,
        lambda line: print(f"lidar-buildings: {line}", file=sys.stderr),
    )
    return replace(request, inputs=with_clouds(request.inputs, folder), bags=tuple(records))
