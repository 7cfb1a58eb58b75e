"""The classified clouds of a run: every input written again with what the tiles found."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError, OutputError
from lidar_buildings.io.clouds.classified_las import suffix_for, write_classified
from lidar_buildings.io.clouds.las import InputFile, open_cloud
from lidar_buildings.io.files.atomic_files import write_error
from lidar_buildings.io.results.point_results import PointResults
from lidar_buildings.io.results.run_folder import CLASSIFIED, PARTIAL, Share, output_names
from lidar_buildings.io.results.tile_products import load_sources


@dataclass
class ClassifiedFiles:
    """
    What was written.

    Attributes
    ----------
    outputs : list of str or None
        Per input the file's name in the output folder, None where the input could not be read.
    problems : dict
        Number of each of those inputs → one line.
    per_class : ndarray of int64, shape (256,)
        Number of points per class.
    n_known : int
        Points in finished tiles.
    """

    outputs: list[str | None] = field(default_factory=list)
    problems: dict[int, str] = field(default_factory=dict)
    per_class: NDArray[np.int64] = field(default_factory=lambda: np.zeros(256, dtype=np.int64))
    n_known: int = 0


class _Job(NamedTuple):
    """What one input's file is written from."""

    folder: Path
    number: int
    input: InputFile
    name: str
    fragments: list[Path]
    without: Collection[int]


class _Written(NamedTuple):
    """What became of one input's file."""

    output: str | None = None
    problem: str = ""
    per_class: NDArray[np.int64] | int = 0
    n_known: int = 0
    error: OutputError | None = None


def write_clouds(
    folder: Path,
    inputs: Sequence[InputFile],
    fragments: Sequence[Path],
    *,
    without: Collection[int],
    share: Share = map,
) -> ClassifiedFiles:
    """
    Write every input's classified file; an input that cannot be read is noted, the others are written.

    Parameters
    ----------
    folder : Path
        The output folder.
    inputs : sequence of InputFile
    fragments : sequence of Path
        Saved tiles, sorted by stamp.
    without : collection of int
        Ids of buildings to leave out.
    share : callable
        As `map`; may call the function for several files at the same time, in other processes.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    touching: list[list[Path]] = [[] for _ in inputs]
    for fragment in fragments:
        for source in load_sources(fragment):
            if source < len(inputs):
                touching[source].append(fragment)
    if inputs:
        _make_folder(folder / CLASSIFIED)
    jobs = [
        _Job(folder, number, one, name, touching[number], without)
        for number, (one, name) in enumerate(zip(inputs, output_names(inputs), strict=True))
    ]
    written = ClassifiedFiles()
    for number, one in enumerate(share(_write_cloud, jobs)):
        if one.error is not None:
            raise one.error
        written.outputs.append(one.output)
        if one.problem:
            written.problems[number] = one.problem
        written.per_class += one.per_class
        written.n_known += one.n_known
    return written


def _write_cloud(job: _Job) -> _Written:
    """Write one input's file; return what was written, or why it is impossible."""
    table = job.folder / PARTIAL / f"{job.number}.results"
    try:
        cloud = open_cloud(job.input.path)
        if cloud.point_count != job.input.point_count:
            raise InputError(f"{cloud.path}: has changed during the run: run it again with --overwrite")
        output = f"{CLASSIFIED}/{job.name}{suffix_for(cloud)}"
        with PointResults(table, cloud.point_count) as results:
            results.fill(job.fragments, job.number, without=job.without)
            per_class = write_classified(cloud, results.rows, job.folder / output)
            return _Written(output, "", per_class, results.n_known())
    except InputError as error:
        return _Written(problem=str(error))
    except OutputError as error:
        return _Written(error=error)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise write_error(folder, error) from error
