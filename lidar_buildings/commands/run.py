"""The command ``lidar-buildings run``: files or bags in, output folder out, with or without the graph."""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from multiprocessing import get_context
from typing import TYPE_CHECKING

from lidar_buildings.commands.progress import RunOutcome, outcome_as_json, tell_outcome, tell_problems
from lidar_buildings.commands.run_request import RunRequest, request_of
from lidar_buildings.core.freed_memory import tune_malloc
from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import ExitStatus, LidarBuildingsError, ParameterError
from lidar_buildings.core.scans.config import MOST_LOST
from lidar_buildings.io.bags.bag_inputs import bags_among, bags_beside_clouds, bags_of
from lidar_buildings.io.clouds.find_inputs import search_inputs
from lidar_buildings.io.files.failures import log_to_terminal
from lidar_buildings.io.files.locations import is_url
from lidar_buildings.io.results.run_folder import (
    PARTIAL,
    PLACED,
    Use,
    add_to_run,
    check_folder,
    discard_unfinished,
    sole_use,
)
from lidar_buildings.io.results.run_summary import counted

if TYPE_CHECKING:  # what reads and writes files is imported while the processes of a run start
    from lidar_buildings.io.vectors.footprints import FootprintFile


def run_command(options: argparse.Namespace) -> int:
    """Run the whole job; return 0, 2 if some input could not be read, 3 if a tile failed, 4 for a look."""
    log_to_terminal()
    request = request_of(options)
    with sole_use(request.output):
        started = time.perf_counter()
        request, outcome = carry_out(request, options)
        return _report(request, options, outcome, time.perf_counter() - started)


def carry_out(
    request: RunRequest, options: argparse.Namespace, n_processes: int | None = None
) -> tuple[RunRequest, RunOutcome]:
    """
    Run a job in a folder that is locked; return the request, with what was found of bags, and the outcome.

    Without the graph or workers it takes so many processes, one a core if not given.
    """
    if request.overwrite:
        discard_unfinished(request.output)
    _check_places(request)
    compiling = start_compiling()
    request = with_fetched_inputs(with_placed_bags(request))
    footprints = _footprints(request)
    if compiling is not None:
        compiling.wait()
    return request, _outcome(request, options, footprints, n_processes)


def _report(request: RunRequest, options: argparse.Namespace, outcome: RunOutcome, wall: float) -> int:
    tell_problems(outcome, " with --retry-failed" if outcome.failed and options.no_ros else "")
    if options.json:
        print(json.dumps(outcome_as_json(request.output, outcome, wall), indent=2))
    elif not options.quiet:
        tell_outcome(request.output, outcome, wall)
    if request.fetched:
        add_to_run(request.output, {"bounds": request.bounds, "fetched": request.fetched})
    has_bag = outcome.recording is None or not outcome.recording.failure
    if outcome.failed or (outcome.summary.n_unclassified and not outcome.summary.problems):
        return ExitStatus.TILE_FAILED
    if outcome.summary.problems or not has_bag:
        return ExitStatus.WRONG_USE
    if options.strict and outcome.summary.n_doubtful:
        print(f"lidar-buildings: --strict: {_strict_words(outcome)}", file=sys.stderr)
        return ExitStatus.DOUBTFUL
    # the bags' own lines have said why
    is_lost = any(bag.get("lost", 0.0) > MOST_LOST for bag in request.bags)
    return ExitStatus.DOUBTFUL if is_lost else ExitStatus.DONE


def _strict_words(outcome: RunOutcome) -> str:
    n, total = outcome.summary.n_doubtful, sum(outcome.summary.quality.values())
    return f"{n:,} of {counted(total, 'building')} not good: look at their quality_reasons in the report"


def _check_places(request: RunRequest) -> None:
    """Refuse what names no cloud, and a folder that cannot be used, before anything takes time."""
    if not any(is_url(one) or bags_of(one) for one in request.inputs):
        search_inputs(request.inputs)
    check_folder(request.output, overwrite=request.overwrite or request.use is not Use.NONE)


def _footprints(request: RunRequest) -> FootprintFile | None:
    """Read the footprints, if any are given, and refuse them if none lies within the clouds."""
    if request.footprints is None:
        return None
    from lidar_buildings.io.clouds.las import frame_of, open_inputs
    from lidar_buildings.io.vectors.footprints import check_overlap, read_footprints

    clouds, _ = open_inputs(request.inputs)
    frame = frame_of(clouds, request.crs)
    found = read_footprints(request.footprints, frame)
    limits = [(*cloud.mins[:2], *cloud.maxs[:2]) for cloud in clouds if cloud.point_count]
    if limits:
        west, south, east, north = zip(*limits, strict=True)
        check_overlap(found, (min(west), min(south), max(east), max(north)), frame)
    return found


def _outcome(
    request: RunRequest,
    options: argparse.Namespace,
    footprints: FootprintFile | None,
    n_processes: int | None,
) -> RunOutcome:
    if not options.no_ros:
        if importlib.util.find_spec("rclpy") is None:
            raise LidarBuildingsError(
                "rclpy is not installed: source a ROS 2 Jazzy workspace, or pip install '.[ros]' "
                "in the sources, or add --no-ros"
            )
        from lidar_buildings.commands.running_graph import run_graph

        return run_graph(request)
    is_cluster = options.workers or options.scheduler
    if is_cluster and importlib.util.find_spec("distributed") is None:
        raise LidarBuildingsError(
            "--workers and --scheduler need dask.distributed: pip install '.[cluster]' in the sources"
        )
    from lidar_buildings.commands.run_local import run_local

    if is_cluster:
        from lidar_buildings.pipeline.tile_cluster import TileCluster

        with TileCluster(options.workers, options.scheduler) as cluster:
            print(f"dashboard: {cluster.dashboard}", file=sys.stderr)
            return run_local(request, footprints, cluster)
    from lidar_buildings.commands.stage_calls import load_stages
    from lidar_buildings.pipeline.building_pool import BuildingPool

    tune_malloc()
    load_stages()  # before the pool: its processes are forked
    with BuildingPool(n_processes) as pool:
        return run_local(request, footprints, pool)


def with_placed_bags(request: RunRequest) -> RunRequest:
    """
    Return the request with a LAZ file for each bag.

    The files stand among the unfinished tiles of the output folder, and go with them; an interrupted run goes
    on with those that are there. ParameterError if something is said of bags and no input is one; InputError
    or OutputError if a bag cannot be read or placed.
    """
    for one in request.inputs:
        if bags := bags_beside_clouds(one):
            names = ", ".join(bag.name for bag in bags)
            print(
                f"lidar-buildings: {one}: contains point clouds; ignoring its bags: {names}", file=sys.stderr
            )
    if not bags_among(request.inputs):
        told = {**asdict(request.choice), "georeferenced": request.scans.georeferenced}
        if given := [f"--{name}" for name, value in told.items() if value]:
            raise ParameterError(f"{', '.join(given)}: is about bags, but no INPUT is a bag")
        return request
    from lidar_buildings.io.bags.bag_inputs import place_bags, with_clouds

    folder = request.output / PARTIAL / PLACED
    records = place_bags(
        request.inputs,
        folder,
        request.choice,
        request.scans,
        lambda line: print(f"lidar-buildings: {line}", file=sys.stderr),
    )
    return replace(request, inputs=with_clouds(request.inputs, folder), bags=tuple(records))


def with_fetched_inputs(request: RunRequest) -> RunRequest:
    """
    Return the request with files of this machine instead of URLs, and of all inputs what lies in the bounds.

    The files stand beside those of bags, and stay as long. InputError or OutputError if an input cannot be
    cut or none has points in the bounds, or a file not be written.
    """
    if request.bounds is None and not any(map(is_url, request.inputs)):
        return request
    from lidar_buildings.io.clouds.fetch import fetched

    folder = request.output / PARTIAL / PLACED
    # a process of its own: threads that it leaves behind would keep pools from being forked
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        found = process.submit(fetched, request.inputs, folder, request.bounds).result()
    return replace(request, inputs=tuple(found), fetched=found)
