"""What source and writer are told of a run. It needs no ROS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lidar_buildings.io.bags.bag_inputs import bags_among
from lidar_buildings.io.results.run_folder import PARTIAL, PLACED
from lidar_buildings.io.tiling.live_files import CLOUDS
from lidar_buildings.nodes.table import SOURCES, topics_until


def feed_folder(output: str | Path) -> Path:
    """Return the folder, within that of the results, in which the points of a feed, or of bags, wait."""
    return Path(output) / PARTIAL / PLACED


def run_settings(
    source: str,
    inputs: Sequence[str],
    output: str,
    until: str = "building_model",
    *,
    is_recorded: bool = False,
) -> dict[str, dict[str, Any]]:
    """
    Return ``{stage: {name: value}}`` of the source and the writer.

    Where the recorder listens to `points`, too, it is named twice, so that both are waited for.
    """
    waits = {"wait_for": topics_until(until, has_writer=bool(output)) + ("points",) * is_recorded}
    writer = {"output": output, "until": until}
    folder = feed_folder(output)
    if source == SOURCES[0]:
        given: dict[str, Any] = {"input": tuple(inputs)}
        if output and bags_among(inputs):
            given["placed"] = str(folder)
        return {source: given | waits, "model_writer": given | writer}
    spool = {"spool": str(folder)} if output else {}
    return {source: {**spool, **waits}, "model_writer": {"placed": str(folder / CLOUDS), **writer}}
