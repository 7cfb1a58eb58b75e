"""The benchmark of the whole chain: its inputs, how it watches a process, its tables."""

import json
import os
import sys

import laspy
import numpy as np
import pytest

from bench.chain import report
from bench.chain import run as chain
from bench.chain.child import PERIOD, Watch, run_child
from bench.chain.copies import GAP, PAUSE, input_files
from bench.chain.decoding import decode
from bench.chain.live import Sending, latencies
from bench.pages import landings


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    """Two small files side by side, with an extra dimension, far from the origin."""
    folder = tmp_path_factory.mktemp("clouds")
    rng = np.random.default_rng(0)
    for name, west in (("a", 84_808.0), ("b", 84_828.0)):
        header = laspy.LasHeader(version="1.2", point_format=1)
        header.scales, header.offsets = (0.001, 0.01, 0.001), (0.0, 447_000.0, 0.0)
        header.add_extra_dim(laspy.ExtraBytesParams("note", "u2"))
        las = laspy.LasData(header)
        las.x, las.y = west + rng.uniform(0, 20, 50), 447_412.0 + rng.uniform(0, 10, 50)
        las.z, las.gps_time, las.note = rng.uniform(0, 5, 50), rng.uniform(0, 7, 50), np.arange(50)
        las.write(folder / f"{name}.laz")
    return sorted(folder.glob("*.laz"))


def test_copies_are_the_same_points_elsewhere_and_later(clouds, tmp_path):
    copies = input_files(clouds, 3, tmp_path)
    assert len(copies) == 6
    first, moved, below = (laspy.read(copies[2 * number]) for number in range(3))
    for axis in "XYZ":
        np.testing.assert_array_equal(first[axis], laspy.read(clouds[0])[axis])
    # 40 and 10 m wide but for what chance leaves free at the ends, in whole metres
    east, south = np.unique(moved.X - first.X), np.unique(below.Y - first.Y)
    assert east.tolist() == [(40 + GAP) * 1000]
    assert south.tolist() == [(10 + GAP) * 100]
    assert (moved.Y == first.Y).all()
    assert (below.X == first.X).all()
    shift = np.ptp(moved.gps_time - first.gps_time), (moved.gps_time - first.gps_time)[0]
    assert shift[0] < 1e-9
    assert shift[1] >= 6 + PAUSE
    for name in ("Z", "note", "intensity"):
        np.testing.assert_array_equal(moved[name], first[name])
    times = [path.stat().st_mtime_ns for path in copies]
    assert [path.stat().st_mtime_ns for path in input_files(clouds, 3, tmp_path)] == times, "made once"
    assert input_files(clouds, 1, tmp_path) == clouds
    assert decode([str(path) for path in copies[:2]]) == 100


def test_a_child_s_memory_time_and_temporary_files_are_counted(tmp_path, monkeypatch):
    allowed, output, looked = os.sched_getaffinity(0), tmp_path / "out", tmp_path / "looked"
    output.mkdir()
    look = Watch.look

    def noted(watch, pid):
        look(watch, pid)
        with looked.open("a") as file:
            file.write("*")

    monkeypatch.setattr(Watch, "look", noted)
    program = """
import os, sys, tempfile, time
held = bytearray(b"x") * 60_000_000
(kept, partial) = (os.path.join(sys.argv[1], name) for name in ("kept", ".partial"))
for path, size in ((kept, 5000), (partial, 300), (os.path.join(tempfile.gettempdir(), "spool"), 20)):
    with open(path, "wb") as file:
        file.write(bytes(size))
n_looks = lambda: os.path.exists(sys.argv[2]) and os.path.getsize(sys.argv[2])
until = n_looks() + 2  # one may have begun before
while n_looks() < until:
    time.sleep(0.01)
os.remove(partial)
print(len(os.sched_getaffinity(0)))
"""
    used = run_child([sys.executable, "-c", program, str(output), str(looked)], cores=1, output=output)
    assert used.printed == "1\n"
    assert used.memory > 60_000_000
    assert used.disk == 320
    assert used.cpu > 0
    assert used.wall > PERIOD
    assert used.others >= 0
    with pytest.raises(SystemExit, match="status 3:\nwhy"):
        run_child([sys.executable, "-c", "print('why'); raise SystemExit(3)"])
    assert os.sched_getaffinity(0) == allowed


def _run(*, is_ros: bool, wall: float) -> dict:
    key = f"Delft × 1 2 {is_ros}"
    sizes = {"points": 800_000, "tiles": 4, "buildings": 45, "memory": 9e8, "disk": 5e7}
    times = {"wall": wall, "cpu": 2 * wall, "others": 0.31, "decoding_wall": 0.5, "decoding_cpu": 1.0}
    return {"key": key, "name": "Delft × 1", "cores": 2, "is_ros": is_ros, **sizes, **times}


def test_runs_are_set_beside_decoding_and_ros_beside_none():
    made = report.runs_table([_run(is_ros=False, wall=4.0), _run(is_ros=True, wall=5.0)])
    plain, ros = (dict(zip(made.headings, row, strict=True)) for row in made.rows)
    assert (plain["M points/s"], plain["CPU × decoding"], plain["wall × decoding"]) == ("0.200", "8", "8")
    assert (plain["wall, ROS / ROS-free"], ros["wall, ROS / ROS-free"]) == ("", "1.25")
    assert ros["others' CPU s"] == "0.3"
    assert (ros["memory MB"], ros["temporary MB"]) == ("900", "50")


def test_a_landing_takes_the_place_of_the_last_and_has_a_line_of_its_own(tmp_path, monkeypatch, capsys):
    document, record = tmp_path / "benchmarks.md", tmp_path / "figures.json"
    head = f"| {' | '.join(report.LANDING)} |\n|{'---|' * len(report.LANDING)}\n"
    document.write_text(f"# Benchmarks\n\n{head}\n### Last measured: one before\n\nIts tables.\n")
    cpu = dict.fromkeys(report.LANDING[5:], 0.25)
    stages = {"name": "Delft", "points": 800_000, "cpu": cpu}
    record.write_text(json.dumps({"runs": [_run(is_ros=False, wall=4.0)], "stages": [stages]}))
    monkeypatch.setattr(chain, "DOCUMENT", document)
    chain.main(["--only", "--record", str(record), "--landing", "A landing"])
    before, _, after = document.read_text().partition("\n\n### Last measured: A landing\n\n")
    assert before.startswith(f"# Benchmarks\n\n{head}| A landing |")
    (line,) = landings.table(before, landings.HEAD)
    assert (line["wall s"], line["wall s, ROS"], line["roof selection"]) == ("4.0", "", "0.25")
    assert after.startswith("Whole runs")
    assert "| Delft × 1 | 2 | 4 | 800,000 |" in after
    assert "Its tables" not in after
    assert "Delft × 1" in capsys.readouterr().out
    chain.main(["--only", "--record", str(record), "--landing", "Another"])
    assert [one["landing"] for one in landings.table(document.read_text(), landings.HEAD)] == [
        "A landing",
        "Another",
    ]


def test_latencies_of_a_feed_count_from_a_tiles_last_point():
    sendings = [
        Sending(1, 0, 100, False, 0.0, 1.0, 3.0),
        Sending(2, 0, 300, True, 0.0, 1.0, 2.0),
        Sending(2, 1, 500, False, 5.0, 15.0, 16.0),
        Sending(3, 0, 200, True, 0.0, 1.0, 2.0),
    ]
    found = latencies(sendings, end=12.0)
    first = found["first"]
    assert (first["n"], first["points"]) == (3, 200)
    assert (first["latency"][0], first["latency"][2]) == (2.0, 3.0)
    assert (first["of_it_in_the_graph"][0], first["of_it_in_the_graph"][2]) == (1.0, 2.0)
    assert found["all"]["n"] == 4
    assert found["all"]["latency"][2] == 11.0
    assert [
        found[kind][name] for kind in ("last", "last_in_flight", "whole") for name in ("n", "points")
    ] == [3, 200, 2, 150, 1, 100]
