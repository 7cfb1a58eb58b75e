"""The classified clouds of a run: every input written again with what the tiles found."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.classified_las import suffix_for, write_classified
from lidar_buildings.io.clouds.las import InputFile, open_cloud
from lidar_buildings.io.files.atomic_files import write_error
from lidar_buildings.io.results.point_results import PointResults
from lidar_buildings.io.results.run_folder import CLASSIFIED, PARTIAL, output_names
from lidar_buildings.io.results.tile_products import load_rows


@dataclass
class ClassifiedFiles:
    """
    What was written.

    Attributes
    ----------
    outputs : list of str or None
        Per input the file's name in the output folder, None where the input could not be read.
    problems : list of str
        One line for each of those.
    per_class : ndarray of int64, shape (256,)
        Number of points per class.
    n_known : int
        Points in finished tiles.
    """

    outputs: list[str | None] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    per_class: NDArray[np.int64] = field(default_factory=lambda: np.zeros(256, dtype=np.int64))
    n_known: int = 0


def write_clouds(
    folder: Path, inputs: Sequence[InputFile], fragments: Sequence[Path], *, without: Collection[int]
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

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    written = ClassifiedFiles()
    touching: list[list[Path]] = [[] for _ in inputs]
    for fragment in fragments:
        for source in load_rows(fragment, "sources"):
            if source < len(inputs):
                touching[source].append(fragment)
    for source, name in enumerate(output_names(inputs)):
        table = folder / PARTIAL / f"{source}.results"
        try:
            cloud = open_cloud(inputs[source].path)
            if cloud.point_count != inputs[source].point_count:
                raise InputError(f"{cloud.path}: has changed during the run: run it again with --overwrite")
            output = f"{CLASSIFIED}/{name}{suffix_for(cloud)}"
            _make_folder(folder / CLASSIFIED)
            with PointResults(table, cloud.point_count) as results:
                results.fill(touching[source], source, without=without)
                written.per_class += write_classified(cloud, results.rows, folder / output)
                written.n_known += results.n_known()
            written.outputs.append(output)
        except InputError as error:
            written.problems.append(str(error))
            written.outputs.append(None)
    return written


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise write_error(folder, error) from error
