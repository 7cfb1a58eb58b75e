"""What ``run.json`` holds beside what the output folder counts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from lidar_buildings.io.files.library_versions import library_versions


def run_info(
    seconds: Mapping[str, float],
    parameters: Mapping[str, Any],
    failed: Mapping[int, str],
    problems: Iterable[str],
) -> dict[str, Any]:
    """Return versions, parameters, seconds by stage, failed tiles and problems of a run."""
    return {
        "versions": library_versions(),
        "parameters": dict(parameters),
        "seconds": {stage: round(taken, 3) for stage, taken in seconds.items()},
        "failed_tiles": [{"tile": stamp, "reason": failed[stamp]} for stamp in sorted(failed)],
        "problems": list(problems),
    }
