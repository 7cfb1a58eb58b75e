"""
The command ``lidar-buildings run``: files in, output folder out, through the node graph or without ROS.

"""

from __future__ import annotations

import argparse
import importlib.util
import logging
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tqdm import tqdm

from lidar_buildings import __version__
from lidar_buildings.core.errors import LidarBuildingsError, ParameterError
from lidar_buildings.io.output_folder import OutputFolder, RunSummary
from lidar_buildings.io.run_folder import discard_unfinished
from lidar_buildings.io.tiling import TileSource, TilingConfig
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline import STAGE_CONFIGS, STAGES, PipelineConfig, stage_config
from lidar_buildings.settings import Settings, read_settings

_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn", "shapely", "laspy", "lazrs", "pyogrio", "pyproj")
_TILING = TilingConfig.stage


@dataclass(frozen=True)
class RunRequest:
    """
    What the user asked for, checked.

    Attributes
    ----------
    inputs : tuple of str
        Files, folders, globs.
    output : Path
        The output folder.
    settings : dict
        What differs from the defaults, by stage.
    config : PipelineConfig
        All stages' configs.
    tiling : TilingConfig
        How the input is cut.
    until : str
        The last stage.
    overwrite : bool
        Whether earlier results may be replaced.
    namespace : str or None
        ROS namespace, None for one of its own.

    """

    inputs: tuple[str, ...]
    output: Path
    settings: Settings
    config: PipelineConfig
    tiling: TilingConfig
    until: str
    overwrite: bool
    namespace: str | None

    def parameters(self) -> dict[str, Any]:
        """
        Return everything that results depend on, as plain values.

        """
        return {**asdict(self.config), _TILING: asdict(self.tiling)}


@dataclass(frozen=True)
class RunOutcome:
    """
    What a run gave.

    Attributes
    ----------
    summary : RunSummary
        What the files hold.
    n_failed : int
        Tiles given up.

    """

    summary: RunSummary
    n_failed: int


def run_command(options: argparse.Namespace) -> int:
    """
    Run the whole job and say what came of it.

    Returns
    -------
    int
        0; 2 if some input could not be read; 3 if a tile failed.

    """
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING)
    request = _request(options)
    if request.overwrite:
        discard_unfinished(request.output)
    started = time.perf_counter()
    outcome = _run_local(request) if options.no_ros else _run_graph(request)
    _report(request, outcome, time.perf_counter() - started)
    if outcome.n_failed or (outcome.summary.n_unclassified and not outcome.summary.problems):
        return 3
    return 2 if outcome.summary.problems else 0


def run_info(seconds: Mapping[str, float], wall: float, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return what ``run.json`` tells beside the counts.

    """
    libraries = {name: _version(name) for name in _LIBRARIES}
    return {
        "versions": {"lidar_buildings": __version__, "python": sys.version.split()[0], **libraries},
        "parameters": dict(parameters),
        "seconds": {"wall": round(wall, 3), **{stage: round(s, 3) for stage, s in seconds.items()}},
    }


@contextmanager
def progress_bar(tile_count: Callable[[], int]) -> Iterator[Callable[[int], None]]:
    """
    Give a function that shows how many tiles are done: a bar on a terminal, plain lines elsewhere.

    """
    is_terminal = sys.stderr.isatty()
    bar = tqdm(total=tile_count(), unit="tile", disable=not is_terminal)

    def show(done: int) -> None:
        bar.total = max(tile_count(), done)
        bar.update(done - bar.n)
        if not is_terminal:
            bar.n = done
            print(f"{done} of {bar.total} tiles done", file=sys.stderr, flush=True)

    with bar:
        yield show


def _request(options: argparse.Namespace) -> RunRequest:
    """
    Check the options.

    """
    settings = read_settings(options.params, options.set, NODE_CONFIGS)
    if options.tile_size is not None:
        settings.setdefault(_TILING, {})["tile_size"] = options.tile_size
    _check_stages(settings)
    stages = {stage: values for stage, values in settings.items() if stage in STAGE_CONFIGS}
    return RunRequest(
        inputs=tuple(options.input),
        output=options.output,
        settings=settings,
        config=PipelineConfig.from_settings(stages),
        tiling=_tiling(settings.get(_TILING, {})),
        until=_last_stage(options.until),
        overwrite=options.overwrite,
        namespace=options.namespace,
    )


def _check_stages(settings: Settings) -> None:
    """
    Refuse a stage that no node has.

    """
    known = {stage for stages in NODE_CONFIGS.values() for stage in stages}
    for stage in settings:
        if stage not in known:
            stage_config(stage, {})  # raises, with the nearest name


def _tiling(values: Mapping[str, Any]) -> TilingConfig:
    """
    Return what the tile player and the local run share of the player's parameters.

    """
    shared = TilingConfig.__dataclass_fields__
    player = NODE_CONFIGS[_TILING][_TILING]
    for name in values:
        if name not in player.__dataclass_fields__:
            raise ParameterError(
                f"there is no parameter {_TILING}.{name} (there are {', '.join(player.__dataclass_fields__)})"
            )
    player(**values)
    return TilingConfig(**{name: value for name, value in values.items() if name in shared})


def _last_stage(until: str | None) -> str:
    """
    Return the stage to end with; the name of a node stands for its (last) stage.

    """
    if until is None:
        return STAGES[-1]
    by_node = {
        node: next((s for s in reversed(list(of)) if s in STAGES), "") for node, of in NODE_CONFIGS.items()
    }
    by_node |= {"segmentation": "boundary_tracing", "model_builder": "building_model"}
    stage = until if until in STAGES else by_node.get(until, "")
    if not stage:
        raise ParameterError(f"--until {until}: must be one of {', '.join(STAGES)}")
    return stage


def _run_local(request: RunRequest) -> RunOutcome:
    """
    Run without ROS.

    """
    from lidar_buildings.run_local import process_tiles

    started = time.perf_counter()
    skip: set[int] = set()
    with TileSource(request.inputs, request.tiling, skip=skip) as source:
        folder = OutputFolder(
            request.output,
            source.inputs,
            source.frame,
            overwrite=request.overwrite,
            until=request.until,
            parameters=request.parameters(),
        )
        skip |= folder.done_stamps()
        with progress_bar(lambda: source.tile_count - len(skip)) as progress:
            seconds, n_failed = process_tiles(source, folder, request.config, request.until, progress)
        info = run_info(seconds, time.perf_counter() - started, request.parameters())
        info |= {"problems": source.problems, "n_failed_tiles": n_failed}
        return RunOutcome(folder.finalise(info), n_failed)


def _run_graph(request: RunRequest) -> RunOutcome:
    """
    Run through the node graph.

    """
    if importlib.util.find_spec("rclpy") is None:
        raise LidarBuildingsError(
            "rclpy is not installed: source a ROS 2 Jazzy workspace, or pip install 'lidar_buildings[ros]', "
            "or add --no-ros"
        )
    from lidar_buildings.run_graph import run_graph

    return run_graph(request)


def _report(request: RunRequest, outcome: RunOutcome, wall: float) -> None:
    """
    Print what was found and where it is.

    """
    summary = outcome.summary
    for problem in summary.problems:
        print(f"lidar-buildings: {problem}", file=sys.stderr)
    if outcome.n_failed:
        print(f"lidar-buildings: {outcome.n_failed} tiles failed; the rest is complete", file=sys.stderr)
    if summary.n_unclassified:
        print(
            f"lidar-buildings: {summary.n_unclassified:,} points keep the class they had: their tiles failed "
            "or their file could not be read to its end",
            file=sys.stderr,
        )
    counts = ", ".join(f"{n} {status}" for status, n in sorted(summary.buildings.items())) or "none"
    print(f"{summary.n_points:,} points in {summary.n_tiles} tiles, {wall:.1f} s")
    print(f"buildings: {sum(summary.buildings.values())} ({counts})")
    for name in summary.files:
        print(f"  {request.output / name}")


def _version(library: str) -> str:
    """
    Return a library's version, or that it is missing.

    """
    try:
        return version(library)
    except PackageNotFoundError:
        return "unknown"
