"""
A virtual scanner's feed through the live graph, in real time: does the graph keep up, and how late is it.

    python -m bench.chain.live [--scene NAME] [--density D] [--pulse-rate N] [--seconds S] [--set WORD]
    python -m bench.chain.live --bag BAG [--rate R] [--seconds S | --repeat N] [--set WORD]

`lidar-buildings simulate --live` publishes and `lidar-buildings live` listens, each in processes of its own.
So many seconds after the graph was started the scanner ends, and the graph finishes. Both share the machine:
what the scanner takes, the graph lacks. Prints a line of JSON: points that were sent and kept, how long the
graph still had to work, latencies of tiles from their last point (that of their buffer included) to their
models on disk, and memory, which must not grow from third to third of the feed. `graph_cpu` is the time of
all the graph's processes; `times_seen` how often a point was in a tile that was sent, as one's buffer, too.
The run that follows, of all points as one survey, is left out.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.chain.child import adopt_orphans, wait_for_orphans
from bench.chain.repeated import repeat_bags
from bench.common.process_tree import memory_by_process

#: In the child's error output, the line with the latencies.
_MARK = "MEASURED "
_PERIOD = 1.0
#: Tiles that have their last point so long before the end are not sent with all that is left [s].
_FLUSHED = 10.0
_SHARED_MEMORY = Path("/dev/shm")


class Sending(NamedTuple):
    """One sending of a tile: its revision, points, and seconds of its last point, making and being done."""

    tile: int
    revision: int
    n_points: int
    has_gaps: bool
    last_point: float
    made: float
    done: float


def main() -> None:
    """Measure, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--scene", default="city")
    parser.add_argument("--density", default="8")
    parser.add_argument("--pulse-rate", default="70000")
    parser.add_argument("--bag", help="play this one instead: its scanner costs nothing")
    parser.add_argument("--rate", default="1", help="of the bag")
    parser.add_argument("--repeat", type=int, default=0, help="play the whole bag so often, as one long feed")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--set", action="append", default=[], metavar="STAGE.NAME=VALUE")
    print(json.dumps(measure(parser.parse_args())))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Let a scanner, or a bag, and the graph run side by side, and return the figures."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))  # another's scanner is not heard
    with tempfile.TemporaryDirectory() as folder, open(Path(folder) / "log", "w+") as log:
        others, shared, cpu_before = adopt_orphans(), len(os.listdir(_SHARED_MEMORY)), _waited_cpu()
        scanner = None if options.bag else _start_scanner(options)
        output = Path(folder) / "out"
        words = ["--replay", options.bag, "--rate", options.rate] if options.bag else ["--reliable"]
        settings = list(options.set)
        if scanner is not None:  # an own line of the scanner says which parameters its reader needs
            settings += re.findall(r"--set (\S+)", _line_with(scanner, "parameters for the reader"))
        elif not options.repeat:
            words += ["--duration", str(options.seconds * float(options.rate))]
        words += [word for one in settings for word in ("--set", one)]
        child = [
            sys.executable,
            "-m",
            "bench.chain.live",
            "--child",
            str(options.repeat),
            str(output),
            *words,
        ]
        graph = subprocess.Popen(child, stderr=log)
        memory = _watch(scanner, graph, options.seconds)
        report: list[str] = []
        if scanner is not None:
            report = scanner.communicate()[0].splitlines()
            cpu_before = _waited_cpu()
            graph.send_signal(signal.SIGINT)
        graph.wait()
        list(wait_for_orphans(others))
        cpu = _waited_cpu() - cpu_before
        log.seek(0)
        lines = log.read().splitlines()
        told = json.loads(next(line for line in lines if line.startswith(_MARK)).removeprefix(_MARK))
        record = json.loads((output / "run.json").read_text())
    sendings = [Sending(*one) for one in told["sendings"]]
    words_of = " points in " if options.bag is None else ": played "
    return {
        "scanner": next((line for line in [*report, *lines] if words_of in line), ""),
        "n_points": record["n_points"],
        "buildings": record["buildings"],
        "graph_cpu": round(cpu, 1),
        "cpu_us_per_point": round(1e6 * cpu / max(record["n_points"], 1), 2),
        "times_seen": round(sum(one.n_points for one in sendings) / max(record["n_points"], 1), 2),
        "seconds_after": round(told["seconds_after"], 1),
        **latencies(sendings, told["end"]),
        "memory_MB": memory_thirds([one for at, one in memory if at < told["end"]]),
        "most_memory_MB": round(max(sum(one.values()) for _, one in memory) / 1e6),
        "shared_memory_entries": [shared, len(os.listdir(_SHARED_MEMORY))],
    }


def memory_thirds(looks: list[dict[int, int]]) -> dict[str, Any]:
    """Return the most, and the mean of each third of the time: of all processes, and of each lasting one."""
    thirds = [part.tolist() for part in np.array_split(np.array(looks, dtype=object), 3)]
    n_seen = Counter(pid for one in looks for pid in one)

    def means(pids: Iterable[int]) -> list[int]:
        sums = [[sum(one.get(pid, 0) for pid in pids) for one in part] for part in thirds]
        return [round(float(np.mean(part)) / 1e6) for part in sums]

    return {
        "most": round(max(sum(one.values()) for one in looks) / 1e6),
        "thirds": means(n_seen),
        "thirds_of_each": [means([pid]) for pid in sorted(n_seen) if n_seen[pid] > len(looks) / 2],
    }


def _waited_cpu() -> float:
    """Return the processor time of all descendants that have been waited for [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _start_scanner(options: argparse.Namespace) -> subprocess.Popen[str]:
    scene = ["--scene", options.scene, "--density", options.density, "--pulse-rate", options.pulse_rate]
    command = [sys.executable, "-m", "lidar_buildings.cli", "simulate", "--live", "--reliable", "--wait"]
    return subprocess.Popen([*command, *scene], stdout=subprocess.PIPE, text=True)


def latencies(sendings: list[Sending], end: float) -> dict[str, Any]:
    """
    Return quantiles of the latencies of sendings.

    `first` are those of tiles that were not sent before; `last` those after which no points came, so that
    this is the time from a tile's last point to its models; `last_in_flight` those of them whose last point
    came before the last ten seconds of the feed, after which all that is left is sent at once; `whole` those
    of these that have points all over and around them.
    """
    last = list({one.tile: one for one in sendings}.values())
    in_flight = [one for one in last if one.last_point < end - _FLUSHED]
    kinds = {
        "first": [one for one in sendings if one.revision == 0],
        "last": last,
        "last_in_flight": in_flight,
        "whole": [one for one in in_flight if not one.has_gaps],
        "all": sendings,
    }
    return {name: _quantiles(ones) for name, ones in kinds.items() if ones}


def _quantiles(sendings: list[Sending]) -> dict[str, Any]:
    late = np.array([one.done - one.last_point for one in sendings])
    working = np.array([one.done - one.made for one in sendings])
    return {
        "n": len(sendings),
        "points": int(np.median([one.n_points for one in sendings])),
        "latency": [round(float(one), 1) for one in np.quantile(late, [0.5, 0.95, 1.0])],
        "of_it_in_the_graph": [round(float(one), 1) for one in np.quantile(working, [0.5, 0.95, 1.0])],
    }


def _line_with(process: subprocess.Popen[str], words: str) -> str:
    lines = iter(process.stdout.readline, "") if process.stdout else iter(())
    return next(line for line in lines if words in line)


def _watch(
    scanner: subprocess.Popen[str] | None, graph: subprocess.Popen[bytes], seconds: float
) -> list[tuple[float, dict[int, int]]]:
    """Note times and the graph's memory until the scanner ends or has had its time, or the graph ends."""
    end: float | None = None
    memory: list[tuple[float, dict[int, int]]] = []
    while (scanner or graph).poll() is None:
        memory.append((time.monotonic(), memory_by_process(graph.pid)))
        if end is None and memory[-1][1]:
            end = time.monotonic() + seconds
        if scanner is not None and end is not None and time.monotonic() >= end:
            scanner.send_signal(signal.SIGINT)
            end = float("inf")
        time.sleep(_PERIOD)
    return memory


def _child(n_times: int, output: str, words: list[str]) -> int:
    """Run `lidar-buildings live`, and say on stderr when each tile was sent and done."""
    from lidar_buildings.cli import main as command
    from lidar_buildings.commands import live
    from lidar_buildings.core.model.ids import tile_of
    from lidar_buildings.io.tiling.live_feed import LiveFeed
    from lidar_buildings.io.tiling.live_survey import LiveSurvey

    take, finish, told, flush = LiveSurvey.take, LiveSurvey.finish, LiveFeed.finish, LiveFeed.flush
    under_way: dict[int, list[Any]] = {}
    told_at: dict[int, float] = {}
    sendings: list[list[Any]] = []
    ends: list[float] = []

    def noted_take(self: LiveSurvey) -> Any:
        tile = take(self)
        if tile is not None:
            own = self._by_stamp[tile_of(tile.stamp)]
            *gaps, last = self._turn(own.place)
            under_way[own.stamp] = [own.stamp, own.revision, len(tile), any(gaps), last, time.monotonic()]
        return tile

    def noted_told(self: LiveFeed, stamp: int, *, is_done: bool = True) -> None:
        told_at[stamp] = time.monotonic()  # the feed may have scans to place before it takes note
        told(self, stamp, is_done=is_done)

    def noted_finish(self: LiveSurvey, stamp: int, *, is_done: bool = True) -> None:
        own = self._by_stamp.get(tile_of(stamp))
        finish(self, stamp, is_done=is_done)
        if own is not None and own.place not in self._under_way and own.stamp in under_way:
            sendings.append([*under_way.pop(own.stamp), told_at.get(stamp, time.monotonic())])

    def noted_flush(self: LiveFeed) -> int:
        ends.append(time.monotonic())
        return flush(self)

    LiveSurvey.take, LiveSurvey.finish = noted_take, noted_finish  # type: ignore[method-assign]
    LiveFeed.finish, LiveFeed.flush = noted_told, noted_flush  # type: ignore[method-assign]
    live.make_final = lambda *_: None  # the graph alone is measured
    if n_times:
        repeat_bags(n_times)
    status = command(["live", "--output", output, *words])
    figures = {
        "sendings": sendings,
        "end": ends[0],
        "seconds_after": time.monotonic() - ends[0],
    }
    print(_MARK + json.dumps(figures), file=sys.stderr)
    return status


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        raise SystemExit(_child(int(sys.argv[2]), sys.argv[3], sys.argv[4:]))
    main()
