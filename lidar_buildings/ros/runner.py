"""
One node as a process of its own.

"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from lidar_buildings.core.errors import LidarBuildingsError
from lidar_buildings.ros.middleware import prepare_middleware
from lidar_buildings.ros.parameter_files import check_parameter_files
from lidar_buildings.ros.stage_node import StageNode

#: Exit statuses, as those of the command line.
DONE, WRONG_USE = 0, 2


def run_node(node_class: Callable[[], StageNode]) -> int:
    """
    Run one node until it is done or interrupted.

    Parameters
    ----------
    node_class : callable
        Makes the node.

    Returns
    -------
    int
        The node's exit status, or 2 with one line on stderr where a user's mistake keeps it from running.

    """
    prepare_middleware()
    try:
        check_parameter_files(sys.argv)
        rclpy.init()
        return _spin(node_class())
    except (KeyboardInterrupt, ExternalShutdownException):
        return DONE
    except LidarBuildingsError as error:
        return _complain(error)
    except RuntimeError as error:  # rclpy's own, for instance a parameter file that is no YAML
        if rclpy.ok() and "rgument" not in str(error):
            raise
        return _complain(error)
    finally:
        # a launch system sends SIGINT twice
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        rclpy.try_shutdown()


def _spin(node: StageNode) -> int:
    """
    Spin until the node has its outcome; return its exit status.

    """
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        executor.spin_until_future_complete(node.outcome)
        if node.outcome.done():
            node.outcome.result()
        return node.exit_status
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        executor.shutdown()
        node.destroy_node()


def _complain(error: Exception) -> int:
    """
    Write one line.

    """
    sys.stderr.write(" ".join(str(error).split()) + "\n")
    return WRONG_USE
