"""The command ``lidar-buildings live``: the graph on a feed, in one process, until it is interrupted."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from lidar_buildings.commands.replay import Replay
from lidar_buildings.commands.run_request import RunRequest, request_of
from lidar_buildings.commands.running_graph import running_graph
from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.exit_status import ExitStatus
from lidar_buildings.io.results.run_folder import discard_unfinished, sole_use

if TYPE_CHECKING:
    from lidar_buildings.nodes.model_writer import ModelWriter
    from lidar_buildings.nodes.scan_assembler import ScanAssembler
    from lidar_buildings.ros.composition import Composition

#: Period of looking at the nodes, and of telling how far they are [s].
_TICK, _TELL = 0.1, 5.0
_NODE = "scan_assembler"


def live_command(options: argparse.Namespace) -> int:
    """
    Listen to scans and poses until SIGINT or SIGTERM, or play a bag; then finish the tiles that have points.

    Return 0; 2 if a bag could be played in part only; 130 if a second signal came before all was finished:
    the same command goes on.
    """
    request = request_of(options)
    replay = _replay(options, request)
    with sole_use(request.output):
        if request.overwrite:
            discard_unfinished(request.output)
        if (compiling := start_compiling()) is not None:
            compiling.wait()
        namespace = (request.namespace or "").strip("/")
        with running_graph(request, _NODE, namespace, _ros_arguments(options)) as (composition, nodes):
            return _until_interrupted(composition, nodes, replay)


def _replay(options: argparse.Namespace, request: RunRequest) -> Replay | None:
    """Open the bag that is to be played, if one is."""
    if options.replay is not None:
        return Replay(options.replay, request.choice, 1.0 if options.rate is None else options.rate)
    if given := [f"--{name}" for name in ("rate", "start", "duration") if getattr(options, name) is not None]:
        raise ParameterError(f"{', '.join(given)}: applies only to bags: add --replay BAG")
    return None


def _ros_arguments(options: argparse.Namespace) -> list[str]:
    """Return the names of the feed's topics, and their quality of service, as arguments of ROS."""
    names = {"scan": options.topic, "odometry": options.odometry, "fix": options.fix}
    words = [word for topic, name in names.items() if name for word in ("-r", f"{topic}:={name}")]
    if options.reliable:
        namespace = f"/{(options.namespace or '').strip('/')}".rstrip("/")
        for topic, name in names.items():
            full = name if (name or "").startswith("/") else f"{namespace}/{name or topic}"
            words += ["-p", f"qos_overrides.{full}.subscription.reliability:=reliable"]
    return ["--ros-args", *words] if words else []


def _until_interrupted(composition: Composition, nodes: Mapping[str, Any], replay: Replay | None) -> int:
    """Tell how far the feed is; when a signal comes, or a bag is over, have it finished."""
    source: ScanAssembler = nodes[_NODE]
    writer: ModelWriter = nodes["model_writer"]
    with _interruptions() as n_interruptions:
        _tell("listening: press Ctrl-C to finish received points and write the files")
        if replay is None:
            _watch(composition, source, writer, lambda: n_interruptions() > 0)
        else:
            with replay.playing_to(source.tiles):
                _watch(composition, source, writer, lambda: n_interruptions() > 0 or replay.is_over)
            _tell(f"played {replay}")
        _tell("finishing: press Ctrl-C again to leave the rest for the next run")
        n_finished = writer.n_finished
        source.call_soon(source.finish)

        def is_empty() -> bool:
            return writer.is_over and not source.tiles.tile_count

        _watch(
            composition,
            source,
            writer,
            lambda: n_interruptions() > 1 or writer.n_finished > n_finished or is_empty(),
        )
        if is_empty():
            _tell(f"{_come(source)}; nothing to write: no point was placed")
            return ExitStatus.WRONG_USE
        if writer.n_finished == n_finished:
            _tell("stopped: run the same command to resume")
            return ExitStatus.INTERRUPTED
    _tell(f"{_come(source)}; {writer.last_words}")
    return ExitStatus.WRONG_USE if replay is not None and replay.problem else ExitStatus.DONE


def _watch(
    composition: Composition, source: ScanAssembler, writer: ModelWriter, is_over: Callable[[], bool]
) -> None:
    """Wait, and tell now and then what has come."""
    told, next_time = "", time.monotonic() + _TELL
    while not is_over() and not composition.wait(writer, timeout=_TICK):
        if time.monotonic() < next_time:
            continue
        next_time = time.monotonic() + _TELL
        line = f"{_come(source)}; {source.n_done} tiles done"
        if writer.n_clouds_left:
            line += f"; {writer.n_clouds_left} classified clouds to write"
        if line != told:
            _tell(line)
            told = line


def _come(source: ScanAssembler) -> str:
    from lidar_buildings.nodes.scan_assembler import missing_scans  # needs ROS

    counts = source.tiles.counts()
    told = ", ".join(f"{number:,} {name}" for name, number in counts.items() if number)
    return told or missing_scans(source)


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
