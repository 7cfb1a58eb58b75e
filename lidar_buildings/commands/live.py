"""The command ``lidar-buildings live``: the graph on a feed, in one process, until it is interrupted."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_buildings.commands.final_result import make_final
from lidar_buildings.commands.progress import tell_problems
from lidar_buildings.commands.run_request import RunRequest, request_of
from lidar_buildings.commands.running_graph import running_graph
from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import ExitStatus, InputError, ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.bags.bag import CLOUD, FIX, POINT, VECTOR, Bag, BagMessage
from lidar_buildings.io.bags.bag_inputs import NO_SCAN, BagConfig
from lidar_buildings.io.bags.bag_summary import choose_topics, chosen_messages, told_frame
from lidar_buildings.io.bags.placed_cloud import hand_over
from lidar_buildings.io.results.run_folder import discard_unfinished, sole_use
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.tiling.live_feed import LiveFeed
from lidar_buildings.simulation.live.messages import Pace, PlayReport, ahead

if TYPE_CHECKING:
    from lidar_buildings.nodes.model_writer import ModelWriter
    from lidar_buildings.nodes.scan_assembler import ScanAssembler
    from lidar_buildings.ros.composition import Composition


#: Messages that are read ahead: half a second of 200 poses and 20 scans.
_AHEAD = 100
#: Share of the room for what waits that a bag fills at most, and how often it is looked [s].
_MOST_WAITING, _LOOK = 0.1, 0.01
#: A longer time between two messages is a pause [s].
_PAUSE = 1.0


class Replay:
    """
    Gives a feed the messages of a bag, from a thread of its own; none is lost, however slow the feed is.

    The rate is a multiple of the recorded time, 0 = as fast as the feed takes it. InputError if the bag
    cannot be read, or it is not clear which topics are meant.
    """

    def __init__(self, path: Path, choice: BagConfig, rate: float) -> None:
        self._bag = Bag(path)
        self._topics = choose_topics(self._bag, choice.topic, choice.odometry)
        self._choice, self._rate, self._report = choice, rate, PlayReport()
        self._error: Exception | None = None
        self._is_over, self._is_stopping = threading.Event(), threading.Event()

    def __str__(self) -> str:
        told = self._report if self._rate else f"{self._report.n_points:,} points, as fast as they were taken"
        return f"{self._bag.path}: {told}"

    @property
    def is_over(self) -> bool:
        """Whether all has been handed over; InputError if a message could not be read, or none was a scan."""
        if self._error is not None:
            raise self._error
        return self._is_over.is_set()

    @contextmanager
    def playing_to(self, feed: LiveFeed) -> Iterator[None]:
        """Play to a feed until the bag or the block is over."""
        thread = threading.Thread(target=self._run, args=(feed,), name="replay", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._is_stopping.set()
            thread.join()

    def _run(self, feed: LiveFeed) -> None:
        try:
            messages = chosen_messages(self._bag, self._topics, self._choice)
            with self._bag, closing(ahead(messages, _AHEAD)) as read:
                self._play(read, feed)
        except Exception as error:
            self._error = error
        self._is_over.set()

    def _play(self, messages: Iterable[BagMessage], feed: LiveFeed) -> None:
        pace = Pace(self._report, _PAUSE, wait=self._is_stopping.wait)
        frame: MapFrame | None = None
        for message in messages:
            if message.type in (POINT, VECTOR):
                frame = told_frame(message, frame or MapFrame())
                continue
            if frame is not None:  # what holds for the whole bag comes first
                feed.add_frame(frame)
                frame = None
            if self._rate and message.topic not in self._topics.of_whole:
                pace.wait_for(round(message.time / self._rate))
            while feed.fullness() > _MOST_WAITING and not self._is_stopping.wait(_LOOK):
                pass
            if self._is_stopping.is_set():
                return
            if message.type == CLOUD:
                self._report.n_scans += 1
                self._report.n_points += int(message.message.width) * int(message.message.height)
            elif message.type == FIX:
                feed.add_fix(message.message)
            hand_over(message, feed)
        if not self._report.n_scans:
            raise InputError(f"{self._bag.path}: {NO_SCAN}")


#: Period of looking at the nodes, and of telling how far they are [s].
_TICK, _TELL = 0.1, 5.0
_NODE = "scan_assembler"


def live_command(options: argparse.Namespace) -> int:
    """
    Listen to scans and poses until SIGINT or SIGTERM, or play a bag; then finish the tiles that have points.

    Their files are there soon; those that `run` makes of all points take their place. Return 0; 2 if a bag
    could be played in part only; 3 if a tile failed; 4 if more than 5 % of the points were lost; 130 if a
    second signal came before all was finished: the same command goes on.
    """
    request = request_of(options)
    given = [f"--{name}" for name in ("rate", "start", "duration") if getattr(options, name) is not None]
    replay = None
    if options.replay is not None:
        replay = Replay(options.replay, request.choice, 1.0 if options.rate is None else options.rate)
    elif given:
        raise ParameterError(f"{', '.join(given)}: applies only to bags: add --replay BAG")
    with sole_use(request.output):
        if request.overwrite:
            discard_unfinished(request.output)
        if (compiling := start_compiling()) is not None:
            compiling.wait()
        namespace = (request.namespace or "").strip("/")
        with running_graph(request, _NODE, namespace, _ros_arguments(options)) as (composition, nodes):
            status = _until_interrupted(composition, nodes, replay)
        has_points = status not in (ExitStatus.WRONG_USE, ExitStatus.INTERRUPTED)
        return _finally(request, status) if has_points else status


def _ros_arguments(options: argparse.Namespace) -> list[str]:
    names = {"scan": options.topic, "odometry": options.odometry, "fix": options.fix}
    words = [word for topic, name in names.items() if name for word in ("-r", f"{topic}:={name}")]
    if options.reliable:
        namespace = f"/{(options.namespace or '').strip('/')}".rstrip("/")
        for topic, name in names.items():
            full = name if (name or "").startswith("/") else f"{namespace}/{name or topic}"
            words += ["-p", f"qos_overrides.{full}.subscription.reliability:=reliable"]
    return ["--ros-args", *words] if words else []


def _until_interrupted(composition: Composition, nodes: Mapping[str, Any], replay: Replay | None) -> int:
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
        source.call_soon(source.finish)

        def is_empty() -> bool:
            return writer.is_over and not source.tiles.tile_count

        def is_finished() -> bool:
            # files of an earlier flush may still be under way
            return source.is_finished and writer.finished_from >= source.told_at

        _watch(composition, source, writer, lambda: n_interruptions() > 1 or is_finished() or is_empty())
        if is_empty():
            _tell(f"{_come(source)}; nothing to write: no point was placed")
            return ExitStatus.WRONG_USE
        if not is_finished():
            _tell("stopped: run the same command to resume")
            return ExitStatus.INTERRUPTED
    _tell(f"{_come(source)}; {writer.last_words}")
    if writer.failed_tiles:
        return ExitStatus.TILE_FAILED
    if loss := source.tiles.loss:
        _tell(loss)
        return ExitStatus.DOUBTFUL
    return ExitStatus.DONE


def _finally(request: RunRequest, status: int) -> int:
    """Replace the files of live tiles by those of a run; return the status, which was that of the feed."""
    _tell("making the files of all points as one survey: press Ctrl-C to keep those of live tiles")
    with _interruptions() as n_interruptions:
        outcome = make_final(request, lambda: n_interruptions() > 0)
    if outcome is None:
        _tell("stopped: the files are those of live tiles; run the same command for those of one survey")
        return ExitStatus.INTERRUPTED
    tell_problems(outcome, "")
    n_buildings = counted(sum(outcome.summary.buildings.values()), "building")
    _tell(f"final files in {request.output}: {counted(outcome.summary.n_tiles, 'tile')}, {n_buildings}")
    if outcome.failed:
        return ExitStatus.TILE_FAILED
    return ExitStatus.DONE if status == ExitStatus.TILE_FAILED else status


def _watch(
    composition: Composition, source: ScanAssembler, writer: ModelWriter, is_over: Callable[[], bool]
) -> None:
    told, next_time = "", time.monotonic() + _TELL
    while not is_over() and not composition.wait(writer, timeout=_TICK):
        if time.monotonic() < next_time:
            continue
        next_time = time.monotonic() + _TELL
        line = f"{_come(source)}; {counted(source.n_done, 'tile')} done"
        if writer.n_clouds_left:
            line += f"; {counted(writer.n_clouds_left, 'classified cloud')} to write"
        if line != told:
            _tell(line)
            told = line


def _come(source: ScanAssembler) -> str:
    from lidar_buildings.nodes.scan_assembler import missing_scans  # needs ROS

    told = ", ".join(_in_words(name, number) for name, number in source.tiles.counts().items() if number)
    return told or missing_scans(source)


def _in_words(name: str, number: int) -> str:
    """Say how many of what a count is of, such as `tiles_waiting`."""
    what, *state = name.split("_")
    if state or what in ("scans", "points"):
        return " ".join([counted(number, what.removesuffix("s")), *state])
    return f"{number:,} {name}"


@contextmanager
def _interruptions() -> Iterator[Callable[[], int]]:
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
