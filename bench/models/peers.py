"""
roofer (3DBAG, GPL) beside this package, where its program is installed: the same clouds, the same footprints.
"""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from bench.models.clouds import CloudModels, buildings_of, points_of

PROGRAM = "roofer"


def is_installed() -> bool:
    """Whether roofer's program is on the path."""
    return shutil.which(PROGRAM) is not None


def roofer_models(
    name: str, files: Sequence[Path], footprints: Path, output: Path
) -> tuple[CloudModels, float]:
    """
    Return roofer's buildings, by its defaults, and the seconds that it took.

    Raises
    ------
    SystemExit
        If the program of this name fails: another package's has the same.
    """
    arguments = [PROGRAM, *map(str, files), str(footprints), str(output)]
    start = time.perf_counter()
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - start
    if done.returncode:
        raise SystemExit(f"{' '.join(arguments)}: status {done.returncode}:\n{done.stdout}{done.stderr}")
    return CloudModels(f"{name}, roofer", buildings_of(output), points_of(output, files)), seconds
