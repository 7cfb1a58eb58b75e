"""The graph in this process, for as long as a command needs it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from lidar_buildings.commands.prepare import load_stages
from lidar_buildings.commands.run_request import RunRequest
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.ros.middleware import prepare_middleware

if TYPE_CHECKING:
    from lidar_buildings.ros.composition import Composition


@contextmanager
def running_graph(
    request: RunRequest,
    source: str,
    namespace: str,
    arguments: Sequence[str] = (),
    *,
    is_quiet: bool = False,
) -> Iterator[tuple[Composition, Mapping[str, Any]]]:
    """
    Compose the nodes that a request needs, and let them spin until the block ends.

    Parameters
    ----------
    request : RunRequest
        What the user asked for.
    source : str
        Node that tiles come from.
    namespace : str
        Of all nodes.
    arguments : sequence of str
        Of ROS.
    is_quiet : bool
        Whether nodes log nothing, as the command prints it once, in one line.

    Raises
    ------
    LidarBuildingsError
        If a node cannot start.
    """
    prepare_middleware(carries_scans=not request.inputs)
    with BuildingPool(prepare=load_stages) as pool:  # before ROS starts its threads
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
