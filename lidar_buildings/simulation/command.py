"""The command ``lidar-buildings simulate``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lidar_buildings.core.model.errors import OutputError, ParameterError
from lidar_buildings.simulation import simulate_survey

#: What is wrong where nothing would be made.
NOWHERE = "simulate: nothing says where to: give --output DIR, --live or --bag DIR"


def simulate_command(options: argparse.Namespace) -> int:
    """
    Make a virtual survey and say where it is.

    OutputError if the folder holds something and may not be replaced, or cannot be written; ParameterError if
    there is no such scene, a value is out of range, or the folder is missing.
    """
    if options.output is None:
        raise ParameterError(NOWHERE)
    check_folder(options.output, options.overwrite)
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


def check_folder(folder: Path, overwrite: bool) -> None:
    """Refuse a folder for a survey that holds something, unless that may be replaced."""
    try:
        is_full = folder.is_dir() and any(folder.iterdir())
    except OSError as error:
        raise OutputError(f"{folder}: {error.strerror}: choose another folder") from error
    if is_full and not overwrite:
        raise OutputError(f"{folder}: is not empty: choose another folder or add --overwrite")
