"""The command ``lidar-buildings plan``: what a run will take, from headers alone."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from dataclasses import asdict
from typing import Any

from lidar_buildings.commands.cost_model import Cost, Way, expected_cost, measure_slowness
from lidar_buildings.commands.run_request import RunRequest, request_of
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.exit_status import ExitStatus
from lidar_buildings.core.neighbours.parallel import n_cores
from lidar_buildings.io.bags.bag_inputs import bags_among
from lidar_buildings.io.clouds.agreement import excess_of
from lidar_buildings.io.clouds.find_inputs import open_each
from lidar_buildings.io.clouds.las import read_extent
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.tiling.tile_size import SurveyPlan, plan_survey


def plan_command(options: argparse.Namespace) -> int:
    """Print what a run of these inputs will take; return 0, or 2 if an input could not be read."""
    logging.basicConfig(format="lidar-buildings: %(message)s", level=logging.WARNING)
    request = request_of(options)
    plan, problems = _planned(request)
    way = Way.CLUSTER if options.workers else Way.PROCESSES if options.no_ros else Way.GRAPH
    n_workers = options.workers or n_cores()
    cost = expected_cost(plan, n_workers, way, request.until, measure_slowness())
    if options.json:
        print(
            json.dumps(
                {**_survey(plan), "workers": n_workers, **asdict(cost), "problems": problems}, indent=2
            )
        )
    else:
        print("\n".join(_lines(plan, n_workers, cost)))
    for problem in problems:
        print(f"lidar-buildings: {problem}", file=sys.stderr)
    return ExitStatus.WRONG_USE if problems else ExitStatus.DONE


def _planned(request: RunRequest) -> tuple[SurveyPlan, list[str]]:
    if bags := bags_among(request.inputs):
        raise InputError(f"{bags[0]}: is a bag: only point clouds can be planned")
    clouds, problems = open_each(request.inputs, read_extent)
    plan = plan_survey(clouds, request.tiling, request.bounds)
    return plan, [*problems, *filter(None, [excess_of(len(clouds))])]


def _survey(plan: SurveyPlan) -> dict[str, Any]:
    """Return what is known of the survey itself."""
    return {
        "files": plan.n_files,
        "points": plan.n_points,
        "crs": plan.system,
        "bounds": plan.bounds,
        "area": plan.area,
        "tiles": plan.n_tiles,
        "tile_size": plan.tile_size,
        "points_of_largest_tile": round(plan.tile_points.max(initial=0.0)),
        "points_with_buffers": round(plan.tile_points.sum()),
    }


def _lines(plan: SurveyPlan, n_workers: int, cost: Cost) -> list[str]:
    west, south, east, north = plan.bounds
    density = plan.n_points / plan.area if plan.area else 0.0
    seen = plan.tile_points.sum() / max(plan.n_points, 1)
    system = plan.system.split(",")[0] or "no reference system named"
    return [
        f"{counted(plan.n_points, 'point')} in {counted(plan.n_files, 'file')}, {system}",
        f"{east - west:,.0f} x {north - south:,.0f} m, of which {plan.area / 1e6:,.3g} km² have points: "
        f"{density:.3g} a square metre",
        f"{counted(plan.n_tiles, 'tile')} of {plan.tile_size:g} m, with up to "
        f"{plan.tile_points.max(initial=0.0):,.0f} points; each point is seen {seen:.2f} times",
        f"expected with {counted(n_workers, 'worker')}:",
        f"  time       {_time(cost.wall)} ({_time(cost.processor)} of processors)",
        f"  memory     {_bytes(cost.memory)}, {_bytes(cost.worker_memory)} a worker",
        f"  temporary  {_bytes(cost.temporary)}",
        f"  results    {_bytes(cost.outputs)}",
    ]


def _time(seconds: float) -> str:
    hours, rest = divmod(round(seconds), 3600)
    if hours:
        return f"{hours} h {rest // 60:02d} min"
    return f"{rest // 60} min {rest % 60:02d} s" if rest >= 60 else f"{seconds:.1f} s"


def _bytes(number: float) -> str:
    return f"{number / 1e9:,.1f} GB" if number >= 1e9 else f"{number / 1e6:,.0f} MB"
