"""The command ``lidar-buildings live``: the graph on a feed, in one process, until it is interrupted."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from lidar_buildings.commands.prepare import load_stages
from lidar_buildings.commands.run_request import RunRequest, request_of
from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.io.results.run_folder import discard_unfinished
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.ros.middleware import prepare_middleware

if TYPE_CHECKING:
    from lidar_buildings.nodes.model_writer import ModelWriter
    from lidar_buildings.nodes.scan_assembler import ScanAssembler
    from lidar_buildings.ros.composition import Composition

DONE, LEFT = 0, 130
#: Period of looking at the nodes, and of telling how far they are [s].
_TICK, _TELL = 0.1, 5.0
_NODE = "scan_assembler"


def live_command(options: argparse.Namespace) -> int:
    """
    Listen to scans and poses until SIGINT or SIGTERM; then finish the tiles that have points.

    Returns
    -------
    int
        0; 130 if a second signal came before all was finished: the same command goes on.
    """
    request = request_of(options)
    if request.overwrite:
        discard_unfinished(request.output)
    if (compiling := start_compiling()) is not None:
        compiling.wait()
    prepare_middleware()
    with BuildingPool(prepare=load_stages) as pool:  # before ROS starts its threads
        return _listen(request, _ros_arguments(options), pool)


def _ros_arguments(options: argparse.Namespace) -> list[str]:
    """Return the names of the feed's topics, and their quality of service, as arguments of ROS."""
    names = {"scan": options.scan, "odometry": options.odometry}
    words = [word for topic, name in names.items() if name for word in ("-r", f"{topic}:={name}")]
    if options.reliable:
        namespace = f"/{(options.namespace or '').strip('/')}".rstrip("/")
        for topic, name in names.items():
            full = name if (name or "").startswith("/") else f"{namespace}/{name or topic}"
            words += ["-p", f"qos_overrides.{full}.subscription.reliability:=reliable"]
    return ["--ros-args", *words] if words else []


def _listen(request: RunRequest, arguments: list[str], pool: BuildingPool) -> int:
    import rclpy  # after the middleware was prepared
    from rclpy.signals import SignalHandlerOptions

    from lidar_buildings.nodes.graph import survey_nodes
    from lidar_buildings.ros.composition import Composition

    context = rclpy.Context()
    rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
    composition = None
    try:
        nodes = survey_nodes(
            (),
            str(request.output),
            source=_NODE,
            until=request.until,
            settings=request.settings,
            overwrite=request.overwrite,
            identity=request.parameters(),
            pool=pool,
            context=context,
            namespace=(request.namespace or "").strip("/"),
        )
        composition = Composition(*nodes.values())
        composition.start()
        return _until_interrupted(composition, nodes)
    finally:
        if composition is not None:
            composition.stop()
        with suppress(Exception):
            rclpy.try_shutdown(context=context)


def _until_interrupted(composition: Composition, nodes: Mapping[str, Any]) -> int:
    """Tell how far the feed is; when a signal comes, have it finished."""
    source: ScanAssembler = nodes[_NODE]
    writer: ModelWriter = nodes["model_writer"]
    with _interruptions() as n_interruptions:
        _tell("listening: Ctrl-C finishes what has come and makes the files")
        _watch(composition, source, writer, lambda: n_interruptions() > 0)
        _tell("finishing: Ctrl-C again leaves the rest for the next time")
        n_saved = writer.n_saved
        source.tiles.flush()
        _watch(composition, source, writer, lambda: n_interruptions() > 1 or writer.n_saved > n_saved)
        if writer.n_saved == n_saved:
            _tell("left: the same command goes on from here")
            return LEFT
    _tell(writer.last_words)
    return DONE


def _watch(
    composition: Composition, source: ScanAssembler, writer: ModelWriter, is_over: Callable[[], bool]
) -> None:
    """Wait, and tell now and then what has come."""
    told, next_time = "", time.monotonic() + _TELL
    while not is_over() and not composition.wait(writer, timeout=_TICK):
        if time.monotonic() < next_time:
            continue
        next_time = time.monotonic() + _TELL
        counts, progress = source.tiles.counts(), source.progress
        words = ", ".join(f"{number:,} {name}" for name, number in counts.items() if number)
        line = f"{words or 'no scan has come'}; {progress.n_done} tiles done"
        if line != told:
            _tell(line)
            told = line


@contextmanager
def _interruptions() -> Iterator[Callable[[], int]]:
    """Count SIGINT and SIGTERM instead of ending."""
    numbers: list[int] = []
    before = {
        one: signal.signal(one, lambda number, _: numbers.append(number))
        for one in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield lambda: len(numbers)
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def _tell(line: str) -> None:
    print(f"lidar-buildings: {line}", file=sys.stderr, flush=True)
