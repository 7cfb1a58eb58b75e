"""One node as a process of its own."""

from __future__ import annotations

import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.ros.interruption import Interruption
from lidar_buildings.ros.middleware import prepare_middleware
from lidar_buildings.ros.parameter_files import check_parameter_files
from lidar_buildings.ros.stage_node import StageNode

#: Exit statuses, as those of the command line.
DONE, WRONG_USE = 0, 2


def run_node(node_class: Callable[[], StageNode], *, carries_scans: bool = False) -> int:
    """
    Run one node until it is done or interrupted by SIGINT or SIGTERM.

    Parameters
    ----------
    node_class : callable
        Makes the node.
    carries_scans : bool
        As in `prepare_middleware`.

    Returns
    -------
    int
        The node's exit status, or 2 with one line on stderr where a user's mistake keeps it from running.
    """
    interruption = Interruption()
    try:
        return _run(node_class, interruption, carries_scans)
    except KeyboardInterrupt:
        return DONE
    finally:
        interruption.disregard_signals()
        rclpy.try_shutdown()
        interruption.ignore_signals()


def _run(node_class: Callable[[], StageNode], interruption: Interruption, carries_scans: bool) -> int:
    """Start ROS and spin the node; print a user's mistake in one line."""
    try:
        prepare_middleware(carries_scans=carries_scans)
        check_parameter_files(sys.argv)
        if (compiling := start_compiling()) is not None:
            compiling.wait()
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        return _spin(node_class(), interruption)
    except ExternalShutdownException:
        return DONE
    except LidarBuildingsError as error:
        return _print_error(error)
    except RuntimeError as error:  # rclpy's own, for instance a parameter file that is no YAML
        if rclpy.ok() and "rgument" not in str(error):
            raise
        return _print_error(error)
    finally:
        interruption.disregard_signals()


def _spin(node: StageNode, interruption: Interruption) -> int:
    """Spin until the node has its outcome; return its exit status."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        node.announce()
        with interruption.waking(executor.wake):
            executor.spin_until_future_complete(node.outcome)
        if node.outcome.done():
            node.outcome.result()
        return node.exit_status
    finally:
        interruption.disregard_signals()
        executor.shutdown()
        node.destroy_node()


def _print_error(error: Exception) -> int:
    sys.stderr.write(" ".join(str(error).split()) + "\n")
    return WRONG_USE
