"""A run through the node graph, all nodes in this process."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

from lidar_buildings.commands.progress import RunOutcome, progress_bar
from lidar_buildings.commands.running_graph import running_graph

if TYPE_CHECKING:
    from lidar_buildings.commands.run_request import RunRequest
    from lidar_buildings.nodes.tile_player import TilePlayer

#: How often the progress is shown [s].
_TICK = 0.1


def run_graph(request: RunRequest) -> RunOutcome:
    """
    Compose the nodes that a run needs, and wait until the writer has made the files.

    Raises
    ------
    LidarBuildingsError
        If a node cannot start or go on.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    namespace = (request.namespace or f"lidar_buildings_{os.getpid()}").strip("/")
    with running_graph(request, "tile_player", namespace, is_quiet=True) as (composition, nodes):
        outcome = _outcome(composition, nodes)
        while outcome.recording is not None and not nodes["recorder"].is_silent:
            time.sleep(_TICK)
        return outcome


def _outcome(composition, nodes) -> RunOutcome:
    """Show the progress until the writer has its outcome."""
    player: TilePlayer = nodes["tile_player"]
    writer = nodes["model_writer"]
    shown = -1
    with progress_bar(lambda: player.progress.n_tiles) as show:
        while not composition.wait(writer, timeout=_TICK):
            done = player.progress.n_done
            if done > max(shown, 0):
                show(done)
                shown = done
        if player.progress.n_done > max(shown, 0):
            show(player.progress.n_done)
    recording = nodes["recorder"].recording if "recorder" in nodes else None
    return RunOutcome(writer.outcome.result(), writer.failed_tiles, recording)
