"""One node as a process of its own: its parameter files, its run, SIGINT and SIGTERM."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from threading import Thread
from types import FrameType

import rclpy
import yaml
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import InputError, LidarBuildingsError
from lidar_buildings.core.model.exit_status import ExitStatus
from lidar_buildings.ros.middleware import prepare_middleware
from lidar_buildings.ros.stage_node import StageNode

#: What ends a node.
_ENDING = (signal.SIGINT, signal.SIGTERM)
_OPTION = "--params-file"


class Interruption:
    """
    Makes a KeyboardInterrupt of SIGINT and of SIGTERM until `disregard_signals`.

    Start ROS without handlers of its own (``SignalHandlerOptions.NO``). Those of rclpy wake the executor
    *before* they shut the context down: an executor that is quick finds nothing to end for, and waits on for
    good. A node that is still being made meets the end of its context in rclpy's C++, which reports it as an
    error. Python's handler marks the exception first, and what waits is woken after.

    Make it in the main thread, before ROS starts.
    """

    def __init__(self) -> None:
        self._is_over = False
        for number in _ENDING:
            signal.signal(number, self._on_signal)

    def disregard_signals(self) -> None:
        """Raise nothing from here on: the process ends, and a launch system sends several signals."""
        self._is_over = True

    @staticmethod
    def ignore_signals() -> None:
        """Keep a late signal from ending the process before Python has."""
        for number in _ENDING:
            signal.signal(number, signal.SIG_IGN)

    @contextmanager
    def waking(self, wake: Callable[[], None]) -> Iterator[None]:
        """Have `wake` called, in another thread, after each signal; nothing disturbs the end of the block."""
        receiver, sender = socket.socketpair()
        sender.setblocking(False)
        thread = Thread(target=_wake_whenever, args=(receiver, wake), daemon=True)
        thread.start()
        signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            self.disregard_signals()
            signal.set_wakeup_fd(-1)
            sender.close()
            thread.join()
            receiver.close()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not self._is_over:
            raise KeyboardInterrupt


def _wake_whenever(receiver: socket.socket, wake: Callable[[], None]) -> None:
    """Wake for whatever comes, until the other end is closed."""
    while receiver.recv(64):
        wake()


def run_node(node_class: type[StageNode]) -> int:
    """
    Run one node until it is done or interrupted by SIGINT or SIGTERM; return its exit status.

    That is 2 with one line on stderr where a user's mistake keeps it from running. Work that has begun and
    cannot be interrupted is left: the process ends at once.
    """
    interruption = Interruption()
    status, is_at_work = int(ExitStatus.DONE), False
    try:
        status, is_at_work = _run(node_class, interruption)
    except KeyboardInterrupt:
        pass
    finally:
        interruption.disregard_signals()
        rclpy.try_shutdown()
        interruption.ignore_signals()
    if is_at_work:
        sys.stderr.flush()
        os._exit(status)
    return status


def _run(node_class: type[StageNode], interruption: Interruption) -> tuple[int, bool]:
    """Start ROS and spin the node; print a user's mistake in one line."""
    try:
        prepare_middleware(carries_scans=node_class.carries_scans)
        check_parameter_files(sys.argv)
        if (compiling := start_compiling()) is not None:
            compiling.wait()
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        return _spin(node_class(), interruption)
    except ExternalShutdownException:
        return ExitStatus.DONE, False
    except LidarBuildingsError as error:
        return _print_error(error), False
    except RuntimeError as error:  # rclpy's own, for instance a parameter file that is no YAML
        if rclpy.ok() and "rgument" not in str(error):
            raise
        return _print_error(error), False
    finally:
        interruption.disregard_signals()


def _spin(node: StageNode, interruption: Interruption) -> tuple[int, bool]:
    """Spin until the node has its outcome; return its exit status, and whether it is still at work."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        node.announce()
        try:
            with interruption.waking(executor.wake):
                executor.spin_until_future_complete(node.outcome)
        except KeyboardInterrupt:
            interruption.disregard_signals()
            node.interrupted(lambda seconds: executor.spin_once(timeout_sec=seconds))
        if node.outcome.done():
            node.outcome.result()
        return node.exit_status, node.is_at_work
    finally:
        interruption.disregard_signals()
        executor.shutdown()
        node.destroy_node()


def _print_error(error: Exception) -> int:
    sys.stderr.write(" ".join(str(error).split()) + "\n")
    return ExitStatus.WRONG_USE


def check_parameter_files(arguments: Sequence[str]) -> None:
    """
    Look at every file that ``--params-file`` names.

    InputError if one cannot be read, or is not of the form that ROS takes: one line.
    """
    for path in _named(arguments):
        try:
            # parsed, not constructed: launch files tag lists as Python's tuples, which ROS takes as lists
            content = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}: give {_OPTION} a readable YAML file") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            place = " ".join(str(error).split())
            raise InputError(f"{path}: not valid YAML ({place}): compare pipeline.param.yaml") from error
        if content is not None and not isinstance(content, yaml.MappingNode):
            raise InputError(f"{path}: no node names at its top: compare pipeline.param.yaml")


def _named(arguments: Sequence[str]) -> Iterator[Path]:
    for option, value in pairwise(arguments):
        if option == _OPTION:
            yield Path(value)
