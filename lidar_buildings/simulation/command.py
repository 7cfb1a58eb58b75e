"""The command ``lidar-buildings simulate``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.simulation import simulate_survey


def simulate_command(options: argparse.Namespace) -> int:
    """
    Make a virtual survey and say where it is.

    Raises
    ------
    OutputError
        If the folder holds something and may not be replaced, or cannot be written.
    ParameterError
        If there is no such scene, or a value is out of range.
    """
    _check_folder(options.output, options.overwrite)
    parameters: dict[str, Any] = {} if options.density is None else {"density": options.density}
    survey = simulate_survey(options.output, options.scene, options.seed, **parameters)
    rate = survey.n_points / max(survey.seconds, 1e-9)
    print(
        f"{options.scene}: {survey.n_buildings} buildings, {survey.n_points:,} points"
        f" in {survey.seconds:.1f} s ({rate / 1e6:.2f} M points/s)"
    )
    for path in (*survey.files, *survey.truth_files):
        print(f"  {path}")
    return 0


def _check_folder(folder: Path, overwrite: bool) -> None:
    try:
        is_full = folder.is_dir() and any(folder.iterdir())
    except OSError as error:
        raise OutputError(f"{folder}: {error.strerror}: choose another folder") from error
    if is_full and not overwrite:
        raise OutputError(f"{folder}: is not empty: choose another folder or add --overwrite")
