"""
The final result of a feed: what `run` makes of all its points, in place of what live tiles gave.

How wide a survey is, how dense, and what its intensities mean is known when its last point has come: tiles,
their spacing and the map's origin follow from that. So the end is a run, on the points as files.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import replace
from multiprocessing import get_context

from lidar_buildings.commands.progress import RunOutcome
from lidar_buildings.commands.run import carry_out
from lidar_buildings.commands.run_request import RunRequest
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.files.failures import log_to_terminal
from lidar_buildings.io.results.run_folder import PARTIAL, PLACED, add_to_run, put_in_place
from lidar_buildings.io.tiling.live_files import CLOUDS
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig, TilingConfig

#: Folder beside the points in which the result is made, until it is whole.
_RESULT = "result"
#: How often it is looked whether it is not wanted any more; a signal that was lost is sent again so late [s].
_TICK, _PATIENCE = 0.1, 5.0


def make_final(request: RunRequest, is_stopped: Callable[[], bool]) -> RunOutcome | None:
    """
    Make the final result of a feed whose points are files in its output folder.

    A process of its own does it: this one has threads of ROS. Return None if it was stopped: the files of
    live tiles stay. LidarBuildingsError if the result cannot be made.
    """
    points = request.output / PARTIAL / PLACED
    final = replace(
        request,
        inputs=(str(points / CLOUDS),),
        output=points / _RESULT / request.output.resolve().name,  # whose name the report has
        tiling=_tiling(request),
        overwrite=True,
        scans=ScanConfig(),
        choice=BagConfig(),
    )
    try:
        outcome = _done_elsewhere(final, is_stopped)
        if outcome is not None:
            add_to_run(final.output, {"feed": request.settings.get(LiveTilingConfig.stage, {})})
            put_in_place(final.output, request.output)
        return outcome
    except BrokenProcessPool as error:
        why = "its process was killed, as where memory is full: the files of live tiles stay"
        raise LidarBuildingsError(f"{request.output}: the final result was not made: {why}") from error
    finally:
        shutil.rmtree(points / _RESULT, ignore_errors=True)


def _tiling(request: RunRequest) -> TilingConfig:
    """Return how a run cuts the points, seen from where the feed was told."""
    view = request.settings.get(LiveTilingConfig.stage, {}).get("view")
    return request.tiling if view is None else replace(request.tiling, view=view)


def _done_elsewhere(request: RunRequest, is_stopped: Callable[[], bool]) -> RunOutcome | None:
    with ProcessPoolExecutor(1, get_context("spawn"), initializer=_begin) as process:
        number, work = process.submit(os.getpid), process.submit(_run, request)
        while not work.done():
            if is_stopped():
                with suppress(ProcessLookupError):
                    os.kill(number.result(), signal.SIGTERM)
            wait([work], _PATIENCE if is_stopped() else _TICK)
    return None if is_stopped() else work.result()


def _begin() -> None:
    """Prepare the process, which only the command ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    log_to_terminal()


def _run(request: RunRequest) -> RunOutcome:
    return carry_out(request, argparse.Namespace(no_ros=True, workers=0, scheduler=""))[1]
