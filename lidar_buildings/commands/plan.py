"""The command ``lidar-buildings plan``: what a run will take, by headers, and what first points tell."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import asdict
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from lidar_buildings.commands.run_request import request_of
from lidar_buildings.core.model.errors import ExitStatus, InputError
from lidar_buildings.core.model.remarks import Remark, gathered
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.neighbours.parallel import n_cores
from lidar_buildings.io.bags.bag_inputs import bags_among
from lidar_buildings.io.clouds.agreement import about_system, excess_of, in_true_units, with_heights_compared
from lidar_buildings.io.clouds.cloud import CloudExtent
from lidar_buildings.io.clouds.doubts import sampled_remarks
from lidar_buildings.io.clouds.find_inputs import open_each
from lidar_buildings.io.clouds.las import open_cloud, read_extent
from lidar_buildings.io.files.failures import log_to_terminal
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.tiling.tile_size import SurveyPlan, plan_survey

# The figures were fitted to runs on two cores with all defaults, with and without ROS: a village,
# Delft once and 16 times, Montpellier, fusa, Toronto, Amsterdam, Saint Barthélemy, and three sparse surveys.
#: Processor time to read a point, do it once, and write it [s].
_POINT = 1.45e-6
#: Processor time of a point in a tile or its buffer [s]: buffers are seen again and again.
_SEEN_POINT = 2.4e-6
#: Processor time of a square metre: rasters, terrain, and houses, however many points they have [s].
_SQUARE_METRE = 9.0e-6
#: Part of a core that several workers lose to each other, and to what one of them does alone.
_LOSS = 0.08
#: Memory of a point of a tile that is worked on, buffer included, and of a square metre of it [bytes].
_POINT_MEMORY, _METRE_MEMORY = 137, 250
#: Temporary files: of a point, and of a square metre [bytes].
_POINT_DISK, _METRE_DISK = 68, 97
#: Results: of a byte of the inputs, and of a square metre [bytes].
_BYTE_OUTPUT, _METRE_OUTPUT = 2.3, 61
#: Share of the work that each stage is, in their order; the rest is reading, rasters and writing.
_STAGE_SHARES = (0.11, 0.15, 0.04, 0.10, 0.05, 0.04, 0.09)
#: Processor time of the calibration on the machine on which the figures were measured [s].
_REFERENCE = 0.00434
#: How often it is repeated; the least counts.
_REPEATS = 3


#: Files of which points are looked at, and how many points.
_LOOKED_AT, _N_SAMPLED = 8, 100_000


class Way(NamedTuple):
    """How a run works: in processes of this machine, through the graph, or on workers of dask."""

    #: Processor time until it works, and of each worker until that does [s].
    start: float
    worker_start: float
    #: Of the command, and of each worker [bytes].
    memory: float
    worker_memory: float
    kept: float  #: temporary files of a point more: it stays decoded [bytes]


PROCESSES = Way(1.6, 0.0, 330e6, 60e6, 30.0)
GRAPH = Way(1.8, 0.0, 430e6, 60e6, 30.0)
#: Workers load compiled loops each for itself, where the others are forked with them.
CLUSTER = Way(2.0, 1.2, 270e6, 160e6, 0.0)


class Cost(NamedTuple):
    """What a run is expected to take."""

    #: Time with nothing else on the machine, and that of all processes [s].
    wall: float
    processor: float
    #: The most at a time of all processes, and of one worker [bytes].
    memory: float
    worker_memory: float
    #: Files that are there for a while, and results [bytes].
    temporary: float
    outputs: float


def expected_cost(
    plan: SurveyPlan, n_workers: int, way: Way, until: str = STAGES[-1], slowness: float = 1.0
) -> Cost:
    """Estimate a run until a stage, with so many processes, on a machine of this slowness."""
    share = 1.0 - sum(_STAGE_SHARES[STAGES.index(until) + 1 :])
    work = _POINT * plan.n_points + _SEEN_POINT * plan.tile_points.sum() + _SQUARE_METRE * plan.area
    work *= slowness * share
    start, worker_start = slowness * way.start, slowness * way.worker_start
    n_busy = min(n_workers, plan.n_tiles) if way is CLUSTER else n_workers
    processor = start + worker_start * n_busy + work
    wall = start + worker_start + work * (1.0 + _LOSS * (n_busy > 1)) / max(n_busy, 1)
    heaviest = np.sort(_POINT_MEMORY * plan.tile_points + _METRE_MEMORY * plan.tile_areas)[::-1]
    return Cost(
        wall,
        processor,
        way.memory + way.worker_memory * n_workers + heaviest[:n_workers].sum(),
        way.worker_memory + heaviest.max(initial=0.0),
        (_POINT_DISK + way.kept) * plan.n_points + _METRE_DISK * plan.area,
        _BYTE_OUTPUT * plan.n_bytes + _METRE_OUTPUT * plan.area,
    )


def measure_slowness() -> float:
    """Return how much longer this machine takes for work as stages do it than the one that was measured."""
    points = np.random.default_rng(0).uniform(0.0, 100.0, (5_000, 3))
    least = math.inf
    for _ in range(_REPEATS):
        began = time.process_time()
        cKDTree(points).query(points, 4)
        least = min(least, time.process_time() - began)
    return least / _REFERENCE


def plan_command(options: argparse.Namespace) -> int:
    """Print what a run of these inputs will take; return 0, or 2 if an input could not be read."""
    log_to_terminal()
    request = request_of(options)
    if bags := bags_among(request.inputs):
        raise InputError(
            f"{bags[0]}: is a bag, or is made LAZ as bags are: only LAS, LAZ and COPC can be planned"
        )
    clouds, problems = open_each(request.inputs, read_extent)
    plan = plan_survey(clouds, request.tiling, request.bounds)
    problems = [*problems, *filter(None, [excess_of(len(clouds))])]
    way = CLUSTER if options.workers else PROCESSES if options.no_ros else GRAPH
    n_workers = options.workers or n_cores()
    clouds = with_heights_compared(in_true_units(clouds, plan.system))
    looked_at = clouds[:: -(-len(clouds) // _LOOKED_AT)]
    of_files = chain((one.remarks for one in clouds), map(_remarks_of, looked_at))
    remarks = gathered([*chain.from_iterable(of_files), *about_system(clouds)])
    cost = expected_cost(plan, n_workers, way, request.until, measure_slowness())
    if options.json:
        told = {**_survey(plan), "workers": n_workers, **cost._asdict(), "problems": problems}
        told["remarks"] = [asdict(one) for one in remarks]
        print(json.dumps(told, indent=2))
    else:
        print("\n".join([*_lines(plan, n_workers, cost), *map(str, remarks)]))
    for problem in problems:
        print(f"lidar-buildings: {problem}", file=sys.stderr)
    return ExitStatus.WRONG_USE if problems else ExitStatus.DONE


def _remarks_of(extent: CloudExtent) -> list[Remark]:
    """Return what some points of a file tell."""
    try:
        return sampled_remarks(open_cloud(extent.path), _N_SAMPLED)
    except InputError:  # said when a run reads it
        return []


def _survey(plan: SurveyPlan) -> dict[str, Any]:
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
