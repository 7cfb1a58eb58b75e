"""What is measured: each part runs its commands in processes of their own and returns records."""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.chain.child import Usage, run_child
from bench.chain.copies import input_files
from lidar_buildings.core.solids.shell import ROOF_SURFACE
from lidar_buildings.evaluation.command.score import KINDS
from lidar_buildings.evaluation.readers.city_model import read_city_model

COMMAND = [sys.executable, "-m", "lidar_buildings.cli"]
#: Cuts the virtual village into 25 tiles [m].
VILLAGE_TILE = 70
#: Of the tile whose way through the graph is timed.
LATENCY_POINTS = 250_000
FOOTPRINTS = "buildings_nw.gpkg"
#: roofer's (3DBAG, GPL).
PROGRAM = "roofer"

Record = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """What to measure."""

    files: tuple[Path, ...]  #: delft's
    folder: Path  #: for inputs that are made, and for results
    copies: tuple[int, ...] = (1, 4, 16)
    cores: tuple[int, ...] = (1, 2)
    repeats: int = 3  #: of what takes a minute or less; the least counts


def runs(job: Job) -> Iterator[Record]:
    """Run the whole chain with all files, without ROS on so many cores, and through the graph on several."""
    there = len(os.sched_getaffinity(0))
    for copies in job.copies:
        files = input_files(job.files, copies, job.folder)
        repeats = job.repeats if copies == 1 else 1
        for cores in job.cores:
            if cores > there:
                yield {"key": f"delft {copies} {cores}", "missing": f"{cores} cores: there are {there}"}
                continue
            for is_ros in (False, True) if cores > 1 else (False,):
                yield _run(job, f"Delft × {copies}", files, [], cores, is_ros, repeats)


def village(job: Job) -> Iterator[Record]:
    """Run the virtual village in many small tiles, with and without ROS."""
    survey = job.folder / "survey"
    run_child([*COMMAND, "simulate", "--output", str(survey), "--overwrite"])
    files = sorted(survey.glob("*.laz"))
    tiles = ["--tile-size", str(VILLAGE_TILE)]
    for is_ros in (False, True):
        yield _run(job, "village", files, tiles, max(job.cores), is_ros, job.repeats)


def stages(job: Job) -> Iterator[Record]:
    """Take each stage alone: Delft's first tile, all of Delft as one cloud, the virtual village."""
    inputs = {
        "Delft, tile 1": [str(job.files[0])],
        "Delft": [str(file) for file in job.files],
        "village": ["--village"],
    }
    for name, arguments in inputs.items():
        yield {"name": name, **_json_of("stages", [str(job.repeats), *arguments])}


def peers(job: Job) -> Iterator[Record]:
    """Model Delft with given footprints, beside roofer where it is installed."""
    footprints = job.files[0].parent / FOOTPRINTS
    if not footprints.is_file():
        yield {"name": "Delft, footprints", "missing": f"{footprints.name}: not there"}
        return
    given = ["--footprints", str(footprints), *map(str, job.files)]
    yield {"name": "Delft, footprints", **_json_of("stages", [str(job.repeats), *given])}
    if shutil.which(PROGRAM) is None:
        yield {"name": PROGRAM, "missing": "no program of this name on the path"}
        return
    output = job.folder / PROGRAM
    command = [PROGRAM, *map(str, job.files), str(footprints), str(output)]
    used = min((run_child(command, cores=1) for _ in range(job.repeats)), key=lambda one: one.cpu)
    solids = [solid for one in read_city_model(output).buildings for solid in one.finest("2.2")[1]]
    faces = sum(solid.semantics.count(ROOF_SURFACE) for solid in solids)
    yield {
        "name": PROGRAM,
        "buildings": len(solids),
        "faces": faces,
        "cpu": used.cpu,
        "wall": used.wall,
    }


def start(job: Job) -> Iterator[Record]:
    """Run the demo (`make demo`) with an empty cache of compiled loops, and once more."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        cache = Path(folder) / "cache"
        for name in ("first", "second"):
            before = n_compiled(cache)
            used = list(_demo(Path(folder), cache))
            yield {
                "name": name,
                "wall": sum(one.wall for one in used),
                "cpu": sum(one.cpu for one in used),
                "others": sum(one.others for one in used),
                "compiled": n_compiled(cache) - before,
            }


def latency(job: Job) -> Iterator[Record]:
    """Send one tile into a graph that runs."""
    arguments = [str(LATENCY_POINTS), str(job.repeats), *map(str, job.files)]
    yield {"name": "latency", **_json_of("latency", arguments, cores=max(job.cores))}


PARTS: dict[str, Callable[[Job], Iterator[Record]]] = {
    "stages": stages,
    "peers": peers,
    "runs": runs,
    "village": village,
    "latency": latency,
    "start": start,
}


def n_compiled(cache: Path) -> int:
    """Count the compiled signatures in a cache of numba's."""
    return len(list(cache.rglob("*.nbc")))


def _run(
    job: Job,
    name: str,
    files: Sequence[Path],
    options: Sequence[str],
    cores: int,
    is_ros: bool,
    repeats: int,
) -> Record:
    """Run the command, and decode the same files on as many cores right before; the least of the repeats."""
    output = job.folder / "result"
    command = [*COMMAND, "run", *map(str, files), "--output", str(output), "--overwrite", *options]
    command += [] if is_ros else ["--no-ros"]
    decoded, used = [], []
    for _ in range(repeats):
        decoded.append(_json_of("decoding", list(map(str, files)), cores=cores))
        used.append(run_child(command, cores=cores, output=output))
    info = json.loads((output / "run.json").read_text())
    quickest = min(used, key=lambda one: one.wall)
    return {
        "key": f"{name} {cores} {is_ros}",
        "name": name,
        "cores": cores,
        "is_ros": is_ros,
        "points": info["n_points"],
        "tiles": info["n_tiles"],
        "buildings": sum(info["buildings"].values()),
        "wall": quickest.wall,
        "others": quickest.others,
        "cpu": min(one.cpu for one in used),
        "memory": max(one.memory for one in used),
        "disk": max(one.disk for one in used),
        "decoding_wall": min(one["wall"] for one in decoded),
        "decoding_cpu": min(one["cpu"] for one in decoded),
    }


def _demo(folder: Path, cache: Path) -> Iterator[Usage]:
    """Run the commands of `make demo`; the second is the run itself."""
    survey, result = str(folder / "survey"), str(folder / "result")
    commands = [
        ["simulate", "--output", survey, "--scene", "village", "--overwrite"],
        ["run", survey, "--output", result, "--overwrite"],
        ["score", ",".join(KINDS), result, survey, "--merge-touching"],
    ]
    for command in commands:
        yield run_child([*COMMAND, *command], environment={"NUMBA_CACHE_DIR": str(cache)})


def _json_of(module: str, arguments: Sequence[str], *, cores: int = 1) -> Record:
    """Run one of this folder's modules on so many cores, and read the last line that it prints."""
    command = [sys.executable, "-m", f"bench.chain.{module}", *arguments]
    used = run_child(command, cores=cores)
    return {**json.loads(used.printed.strip().splitlines()[-1]), "others": used.others}
