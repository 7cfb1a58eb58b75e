"""One node as a process of its own, until it is done, or interrupted by SIGINT or SIGTERM."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import ExitStatus, InputError
from lidar_buildings.ros.middleware import prepare_middleware
from lidar_buildings.ros.stage_node import StageNode

_ENDING = (signal.SIGINT, signal.SIGTERM)


def run_node(node_class: type[StageNode]) -> int:
    """
    Run one node until it is done or interrupted by SIGINT or SIGTERM; return its exit status.

    Work that has begun and cannot be interrupted is left: the process ends at once. LidarBuildingsError if a
    user's mistake keeps the node from running.
    """
    for number in _ENDING:
        signal.signal(number, _interrupt)
    try:
        prepare_middleware(carries_scans=node_class.carries_scans)
        if (compiling := start_compiling()) is not None:
            compiling.wait()
        # rclpy's own handlers would end the context in the middle of what the node does
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        return _spin(node_class())
    except (KeyboardInterrupt, ExternalShutdownException):
        return ExitStatus.DONE
    except RuntimeError as error:  # rclpy's own, for instance a parameter file that is no YAML
        if rclpy.ok() and "rgument" not in str(error):
            raise
        raise InputError(" ".join(str(error).split())) from error
    finally:
        _ignore_signals()
        rclpy.try_shutdown()


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Interrupt the node once: a launch system sends several signals."""
    _ignore_signals()
    raise KeyboardInterrupt


def _ignore_signals() -> None:
    for number in _ENDING:
        signal.signal(number, signal.SIG_IGN)


def _spin(node: StageNode) -> int:
    """Spin until the node has its outcome or is interrupted; return its exit status."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        node.publish_state()
        try:
            executor.spin_until_future_complete(node.outcome)  # timers wake it, and signals are seen
        except KeyboardInterrupt:
            node.interrupted(lambda seconds: executor.spin_once(timeout_sec=seconds))
        if node.outcome.done():
            node.outcome.result()
    finally:
        _ignore_signals()
        executor.shutdown()
        node.destroy_node()
    if node.is_at_work:
        rclpy.try_shutdown()
        sys.stderr.flush()
        os._exit(node.exit_status)
    return node.exit_status
