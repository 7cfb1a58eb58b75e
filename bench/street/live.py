"""
A vehicle's drive through the live graph, in real time: what it costs, how late façades are, and how exact.

    python -m bench.street.live BAG SURVEY [--rate R] [--duration S] [--set STAGE.NAME=VALUE ...]
                                [--keep DIR] [--run RUN]

BAG and SURVEY come from `lidar-buildings simulate --scanner vehicle --bag BAG --output SURVEY`. The bag is
played to `lidar-buildings live`; where both cores are busy with other things, a rate below 1 tells what a
machine of its own would do. RUN has the results of `lidar-buildings run BAG`. Prints lines of JSON:

cost     processor seconds of all of the graph's processes for each second of the drive: until its end, and
         until the last tile was done; points that came and that were kept; tiles sent, and how often a kept
         point was in one
backlog  points and tiles that waited, the most in each third of the drive
late     seconds of the drive from the last point on a place of a façade to the first publication of a façade
         within 2 cm of where it stands at the end: quantiles 0.5, 0.9, 0.95 and the share within 2 s; `most`
         is the same from the time by which the place had 95 % of its points
walls    lines against true walls, live and by the run; `apart` says how far live façades are from those of
         the run
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.common.process_tree import cpu_of, tree_of
from bench.street.lines import Places, offsets_to, places_along
from bench.street.walls import score_files
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.io.tiling.tile_stamps import gps_time_of
from lidar_buildings.io.vectors.layers import read_layer

#: Of the simulated vehicle.
MOUNTING = "0.6,-0.15,1.95,0.8,-1.2,90.5"
#: A façade published so near to where it stands at the end is the same [m].
SAME = 0.02
#: Points so near to a façade in plan are on it [m], and the share of them that are most.
ON, MOST = 0.1, 0.95
_MARK = "MEASURED "
_LOOK = 0.5
#: Places of façades with fewer points are none.
_FEWEST = 10


def main() -> None:
    """Measure, and print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bag", type=Path)
    parser.add_argument("survey", type=Path)
    parser.add_argument("--rate", type=float, default=1.0, help="of the bag")
    parser.add_argument("--duration", help="seconds of the bag")
    parser.add_argument("--mounting", default=MOUNTING)
    parser.add_argument("--set", action="append", default=[], metavar="STAGE.NAME=VALUE")
    parser.add_argument("--keep", type=Path, help="folder for the results")
    parser.add_argument("--run", type=Path, help="results of a run on the bag")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        measure(options, options.keep or Path(temporary))


def measure(options: argparse.Namespace, folder: Path) -> None:
    """Play the bag, and print what came of it."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    words = ["--replay", str(options.bag), "--rate", str(options.rate)]
    words += [] if options.duration is None else ["--duration", options.duration]
    for one in (f"scan_assembler.mounting={options.mounting}", *options.set):
        words += ["--set", one]
    live = folder / "live"
    child = [sys.executable, "-m", "bench.street.live", "--child", str(options.rate), "live"]
    told = _measured([*child, "--output", str(live), "--overwrite", *words])
    for name in ("cost", "backlog"):
        print(json.dumps({name: told[name]}), flush=True)
    print(json.dumps({"late": lateness(told, options.survey)}), flush=True)
    print(json.dumps({"walls": walls(live, options.run, options.survey)}), flush=True)


def _measured(command: list[str]) -> dict[str, Any]:
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        told = ""
        for line in process.stderr:
            if line.startswith(_MARK):
                told = line.removeprefix(_MARK)
            else:
                print(line, end="", file=sys.stderr, flush=True)
    return dict(json.loads(told))


def lateness(told: dict[str, Any], survey: Path) -> dict[str, Any]:
    """Return how late places of façades are published, by the points as they were measured."""
    origin = np.array(told["origin"])
    sent = [(at, tile, [Facade.of_record(one) for one in records]) for at, tile, records in told["published"]]
    final = {tile: facades for _, tile, facades in sent if tile}
    facades = [one for of in final.values() for one in of]
    seen = [line for one in facades for line, is_seen in one.stretches if is_seen and len(line) > 1]
    places = places_along(list(map(shapely.LineString, seen)))
    points, times = _measured_points(survey)
    is_played = times <= told["end"]
    points, times = points[is_played], times[is_played]
    last, most = _last_seen(places, points - origin, times)
    first = np.full(len(last), np.inf)
    for at, _, published in sorted(sent, key=lambda one: one[0]):
        lines = [shapely.LineString(one.foot) for one in published]
        is_new = np.isinf(first) & (offsets_to(places, lines, SAME) <= SAME)
        first[is_new] = at
    known = np.isfinite(last) & np.isfinite(first)
    return {"metres": round(float(places.length[known].sum()))} | {
        name: {
            "quantiles": np.quantile((first - since)[known], [0.5, 0.9, 0.95]).round(2).tolist(),
            "within_2_s": round(float(np.mean((first - since)[known] <= 2.0)), 3),
        }
        for name, since in (("last", last), ("most", most))
    }


def _measured_points(survey: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points of a survey, in its reference system, and their times [s]."""
    clouds = [laspy.read(path) for path in sorted(survey.glob("*.laz"))]
    return np.concatenate([one.xyz for one in clouds]), np.concatenate([one.gps_time for one in clouds])


def _last_seen(
    places: Places, points: NDArray[np.float64], times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return when each place had its last point, and when most of them; NaN where few are."""
    tree = cKDTree(points[:, :2])
    last, most = np.full(len(places.xy), np.nan), np.full(len(places.xy), np.nan)
    for row, near in enumerate(tree.query_ball_point(places.xy, ON)):
        if len(near) >= _FEWEST:
            own = np.sort(times[near])
            last[row], most[row] = own[-1], own[int(MOST * (len(own) - 1))]
    return last, most


def walls(live: Path, run: Path | None, survey: Path) -> dict[str, Any]:
    """Return scores of both against the truth, and how far live façades are from those of the run."""
    scores = {}
    for name, folder in (("live", live), ("run", run)):
        if folder is not None:
            score = score_files(folder / "buildings.gpkg", survey / "truth.gpkg", "street_lines", 0.1)
            scores[name] = {
                "completeness": round(score.completeness, 3),
                "correctness": round(score.correctness, 3),
                "rmse_cm": round(100 * score.rmse, 2),
            }
    if run is None:
        return scores
    lines = [list(read_layer(one / "buildings.gpkg", "street_lines").geometries) for one in (live, run)]
    offset = offsets_to(places_along(lines[0]), lines[1], 0.1)
    is_near = np.isfinite(offset)
    apart = {
        "within_1_cm": round(float(np.mean(offset[is_near] <= 0.01)), 3),
        "within_10_cm": round(float(np.mean(is_near)), 3),
        "cm_95": round(100 * float(np.quantile(offset[is_near], 0.95)), 2),
    }
    return scores | {"apart": apart}


def _child(rate: float, words: list[str]) -> int:
    """Run `lidar-buildings live`, and say on stderr what it published when, what waited, and what it took."""
    from lidar_buildings.cli import main as command
    from lidar_buildings.io.tiling.live_feed import LiveFeed
    from lidar_buildings.io.tiling.live_survey import LiveSurvey
    from lidar_buildings.nodes.stage_nodes import FacadeFinder
    from lidar_buildings.ros.stamps import tile_of, to_stamp

    publish, show = FacadeFinder.publish, FacadeFinder._show
    add, flush, finish = LiveFeed.add_scan, LiveFeed.flush, LiveFeed.finish
    take, grown = LiveSurvey.take, LiveSurvey.grown
    #: When, of which tile (0: of a place), and what.
    published: list[tuple[float, int, list[dict[str, Any]]]] = []
    scans: list[tuple[float, float, float]] = []  # monotonic, of the scanner [s], processor so far
    looks: list[tuple[float, dict[str, int]]] = []
    ends: list[tuple[float, float]] = []
    origins: list[tuple[float, ...]] = []  # of the frame of what is published
    last_tile: list[tuple[float, float]] = []
    last_scan: list[float] = []
    sent: list[int] = []

    def cpu() -> float:
        return cpu_of(tree_of(os.getpid()))

    def noted_show(self: Any, stamp: int, found: Any, *gone: Any) -> Any:
        core = show(self, stamp, found, *gone)
        published.append((time.monotonic(), 0, [one.record for one in core]))
        return core

    def noted_publish(self: Any, stamp: int, found: Any) -> None:
        publish(self, stamp, found)
        published[-1] = (published[-1][0], tile_of(stamp), published[-1][2])

    def noted_add(self: Any, message: Any) -> None:
        stamp = float(gps_time_of(np.array([to_stamp(message.header.stamp)]))[0])
        if not scans:
            threading.Thread(target=look, args=(self,), daemon=True).start()
            scans.append((time.monotonic(), stamp, cpu()))
        last_scan[:] = [stamp]
        add(self, message)

    def look(feed: Any) -> None:
        while not ends:
            looks.append((time.monotonic(), feed.counts()))
            time.sleep(_LOOK)

    def noted_flush(self: Any) -> Any:
        ends.append((time.monotonic(), cpu()))
        looks.append((ends[-1][0], self.counts()))
        origins.append(self.frame.origin)
        return flush(self)

    def noted_finish(self: Any, stamp: int, *, is_done: bool = True) -> None:
        if ends:
            last_tile[:] = [(time.monotonic(), cpu())]
        finish(self, stamp, is_done=is_done)

    def noted_tile(tile: Any) -> Any:
        if tile is not None:
            sent.append(len(tile))
        return tile

    FacadeFinder.publish, FacadeFinder._show = noted_publish, noted_show  # type: ignore[method-assign]
    LiveFeed.add_scan = noted_add  # type: ignore[method-assign]
    LiveFeed.flush, LiveFeed.finish = noted_flush, noted_finish  # type: ignore[method-assign]
    LiveSurvey.take = lambda self: noted_tile(take(self))  # type: ignore[method-assign]
    LiveSurvey.grown = lambda self, *given: noted_tile(grown(self, *given))  # type: ignore[method-assign]
    status = command(words)
    (begin, began, cpu_begin), (end, cpu_end) = scans[0], ends[0]
    done, cpu_done = (last_tile or ends)[0]
    counts, seconds = looks[-1][1], last_scan[0] - began
    thirds = np.array_split(np.array([one for _, one in looks], dtype=object), 3)
    figures = {
        "cost": {
            "seconds": round(seconds, 1),
            "cpu_per_second": round((cpu_end - cpu_begin) / seconds, 2),
            "cpu_per_second_till_done": round((cpu_done - cpu_begin) / seconds, 2),
            "done_after": round(rate * (done - end), 1),
            "points": counts["points"],
            "left_out": {key: n for key, n in counts.items() if key.startswith("left out")},
            "tiles_sent": len(sent),
            "places_skipped": counts["places_skipped"],
            "times_seen": round(sum(sent) / max(counts["points"], 1), 2),
        },
        "backlog": {
            name: [max(one[name] for one in part) for part in thirds]
            for name in ("points_waiting", "tiles_waiting")
        },
        "end": last_scan[0] + 1.0,
        "origin": origins[0],
        "published": [(began + rate * (at - begin), tile, records) for at, tile, records in published],
    }
    print(_MARK + json.dumps(figures), file=sys.stderr)
    return status


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        raise SystemExit(_child(float(sys.argv[2]), sys.argv[3:]))
    main()
