"""The command ``lidar-buildings top``: how the running graphs get on."""

from __future__ import annotations

import argparse
import importlib.util
import os
import shutil
import sys
import time
from contextlib import suppress

from lidar_buildings.core.model.errors import ExitStatus, LidarBuildingsError

#: Period of the blocks [s].
_PERIOD = 1.0
#: What nodes that were there before are given to say how they get on; they do so once a second [s].
_HEARING = 2.5
_CLEAR = "\x1b[H\x1b[2J"


def top_command(options: argparse.Namespace) -> int:
    """
    Print a table of the nodes once a second until all have gone, or once.

    LidarBuildingsError if ROS is not installed, or no graph is found in time.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise LidarBuildingsError(
            "rclpy is not installed: source a ROS 2 Jazzy workspace, or pip install '.[ros]' in the sources"
        )
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from lidar_buildings.commands.graph_view import GraphListener
    from lidar_buildings.nodes.table import NODE_TABLE

    with (
        suppress(KeyboardInterrupt),
        rclpy.Context() as context,
        SingleThreadedExecutor(context=context) as executor,
    ):
        node = rclpy.create_node(f"top_{os.getpid()}", context=context, enable_rosout=False)
        executor.add_node(node)
        listener = GraphListener(node, options.namespace or "", [card.name for card in NODE_TABLE])
        _wait_for_graph(executor, listener, options)
        _listen(executor, _HEARING, lambda: listener.has_all)
        _print(listener.views)
        while not options.once:
            if listener.has_ended():
                print("all nodes have exited")
                break
            _listen(executor, _PERIOD)
            _print(listener.views)
    return ExitStatus.DONE


def _wait_for_graph(executor, listener, options: argparse.Namespace) -> None:
    _listen(executor, options.wait, lambda: bool(listener.views))
    if not listener.views:
        where = f" in namespace {options.namespace}" if options.namespace else ""
        raise LidarBuildingsError(
            f"no lidar_buildings graph was found{where} within {options.wait:g} s: start one first, and "
            "check ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE"
        )


def _listen(executor, seconds: float, is_enough=lambda: False) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0 and not is_enough():
        executor.spin_once(timeout_sec=min(left, 0.1))


def _print(views) -> None:
    """Print the graphs, in place of the last block on a terminal."""
    is_terminal = sys.stdout.isatty()
    width = shutil.get_terminal_size().columns if is_terminal else None
    lines = []
    for namespace, view in views.items():
        lines += [f"graph {namespace or '/'}", *view.lines(time.monotonic()), ""]
    text = "\n".join(line[:width] for line in lines)
    print(f"{_CLEAR if is_terminal else ''}{text}", flush=True)
