"""The node graph in this process, and a run through it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from lidar_buildings.commands.progress import RunOutcome, TilesDone, progress_bar
from lidar_buildings.commands.run_request import RunRequest
from lidar_buildings.commands.stage_calls import load_stages
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.ros.middleware import prepare_middleware

if TYPE_CHECKING:
    from lidar_buildings.ros.composition import Composition


#: How often the progress is shown [s].
_TICK = 0.1


@contextmanager
def running_graph(
    request: RunRequest, source: str, namespace: str, arguments: Sequence[str] = (), *, is_quiet: bool = False
) -> Iterator[tuple[Composition, Mapping[str, Any]]]:
    """
    Compose the nodes that a request needs, and let them spin until the block ends.

    Nodes log nothing if `is_quiet`, as the command prints it once, in one line. LidarBuildingsError if a node
    cannot start.
    """
    prepare_middleware(carries_scans=not request.inputs)
    load_stages()  # before the pool: its processes are forked
    with BuildingPool() as pool:  # before ROS starts its threads
        import rclpy  # after the middleware was prepared
        from rclpy.logging import LoggingSeverity, set_logger_level

        from lidar_buildings.nodes.graph import survey_nodes
        from lidar_buildings.ros.composition import Composition

        context = rclpy.Context()
        rclpy.init(args=list(arguments), context=context)  # with handlers of signals in the default one only
        if is_quiet:
            set_logger_level(namespace.replace("/", "."), LoggingSeverity.FATAL)
        composition = None
        try:
            nodes = survey_nodes(
                request.inputs,
                str(request.output),
                source=source,
                until=request.until,
                settings=request.settings,
                overwrite=request.overwrite,
                identity=request.parameters(),
                pool=pool,
                context=context,
                namespace=namespace,
            )
            composition = Composition(*nodes.values())
            composition.start()
            yield composition, nodes
        finally:
            if composition is not None:
                composition.stop()
            with suppress(Exception):
                rclpy.try_shutdown(context=context)


def run_graph(request: RunRequest) -> RunOutcome:
    """Run a request through the graph until its files are written; LidarBuildingsError if a node fails."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    namespace = (request.namespace or f"lidar_buildings_{os.getpid()}").strip("/")
    with running_graph(request, "tile_player", namespace, is_quiet=True) as (composition, nodes):
        player, writer = nodes["tile_player"], nodes["model_writer"]
        with progress_bar(lambda: player.tiles.tile_count, is_quiet=request.is_quiet) as show:
            is_over = False
            while not is_over:
                is_over = composition.wait(writer, timeout=_TICK)
                counts = writer.summary.counts
                done = TilesDone(counts["tiles_out"], counts["points_out"], counts["buildings"])
                show(player.n_done, done, [name for name in nodes if nodes[name].is_at_work])
        recording = nodes["recorder"].recording if "recorder" in nodes else None
        outcome = RunOutcome(writer.outcome.result(), writer.failed_tiles, recording)
        while recording is not None and not nodes["recorder"].is_silent:
            time.sleep(_TICK)
        return outcome
