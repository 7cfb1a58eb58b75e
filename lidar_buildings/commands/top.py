"""The command ``lidar-buildings top``: how the running graphs get on, by what nodes say on `diagnostics`."""

from __future__ import annotations

import argparse
import importlib.util
import os
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from lidar_buildings.core.model.errors import ExitStatus, LidarBuildingsError
from lidar_buildings.io.results.run_summary import counted

#: A node that has not been heard for so long is silent [s]; wide margin: each speaks once a second.
_SILENT = 5.0
#: Period of the search for graphs [s].
_SEARCH = 0.2
_LEVELS = ("ok", "WARN", "ERROR")
_HEAD = ("node", "state", "in", "out", "in hand", "points/s", "last tile", "input", "level", "message")
#: Columns of words; those of numbers are aligned to the right.
_WORDS = {"node", "state", "level", "message"}


class _Node(NamedTuple):
    level: int
    message: str
    values: Mapping[str, float]
    heard: float


class GraphView:
    """What the nodes of one namespace said last, in an order of names; others come after these, by name."""

    def __init__(self, order: Sequence[str] = ()) -> None:
        self.nodes: dict[str, _Node] = {}
        self._order = order

    def hear(self, node: str, level: int, message: str, values: Mapping[str, float], now: float) -> None:
        """Note how a node gets on."""
        self.nodes[node] = _Node(level, message, values, now)

    def lines(self, now: float) -> list[str]:
        """Return a table of the nodes, and what is known of tiles and buildings beneath."""
        nodes = sorted(self.nodes.items(), key=lambda pair: (self._place_of(pair[0]), pair[0]))
        rows = [_HEAD, *(_row(name, one, now) for name, one in nodes)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        table = [
            "  ".join(
                cell.ljust(width) if name in _WORDS else cell.rjust(width)
                for name, cell, width in zip(_HEAD, row, widths, strict=True)
            ).rstrip()
            for row in rows
        ]
        return [*table, *(line for name, one in nodes for line in _more(name, one.values))]

    def _place_of(self, node: str) -> int:
        """Return where a node stands; those that share a node's tiles, called as it is, stand with it."""
        places = (place for place, name in enumerate(self._order) if node.startswith(name))
        return next(places, len(self._order))


def _row(name: str, one: _Node, now: float) -> tuple[str, ...]:
    values, silence = one.values, now - one.heard
    state = "at work" if values.get("tiles_in_hand") else "idle"
    busy = values.get("seconds", 0.0)
    has_rate = busy > 0 and values.get("points_in") and "tiles_in_flight" not in values  # no source
    last = values.get("seconds_last_tile", 0.0)
    return (
        name,
        state if silence < _SILENT else f"silent {silence:.0f} s",
        f"{values.get('tiles_in', 0):,.0f}",
        f"{values.get('tiles_out', 0):,.0f}",
        f"{values.get('tiles_in_hand', 0):.0f}",
        f"{values['points_in'] / busy:,.0f}" if has_rate else "-",
        f"{last:.2f} s" if last else "-",
        f"{values['input_age'] + silence:.0f} s" if "input_age" in values else "-",
        _LEVELS[one.level],
        one.message,
    )


def _more(name: str, values: Mapping[str, float]) -> list[str]:
    def n(key: str, what: str) -> str:
        return counted(round(values[key]), what)

    lines = []
    if "tiles_in_flight" in values:
        lines.append(
            f"{name}: {n('tiles_done', 'tile')} done, {values['tiles_in_flight']:.0f} in flight, "
            f"{values['tiles_given_up']:,.0f} given up; the last took {values['latency']:.1f} s"
        )
    if "points_waiting" in values:
        left_out = sum(number for key, number in values.items() if key.startswith("left out"))
        lines.append(
            f"{name}: {n('scans', 'scan')}, {n('points', 'point')} kept, "
            f"{values['points_waiting']:,.0f} to be placed, {left_out:,.0f} left out; "
            f"{n('tiles_waiting', 'tile')} queued"
        )
    buildings = [
        f"{n:,.0f} {key.removeprefix('buildings').strip('_')}".rstrip()
        for key, n in sorted(values.items())
        if key.startswith("buildings")
    ]
    if buildings:
        lines.append(f"{name}: buildings: {', '.join(buildings)}")
    return lines


class GraphListener:
    """Keeps a view of every graph, or of one namespace's: `views` by namespace, ordered as `GraphView`."""

    def __init__(self, node: Any, namespace: str = "", order: Sequence[str] = ()) -> None:
        from lidar_buildings.ros.node_state import TOPIC  # rclpy is loaded by the command

        self.views: dict[str, GraphView] = {}
        self._node, self._order, self._topic = node, order, f"/{TOPIC}"
        self._only = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        node.create_timer(_SEARCH, self._search)

    @property
    def has_all(self) -> bool:
        """Whether every node that is there has said how it gets on."""
        return all(
            len(view.nodes) >= self._node.count_publishers(f"{name}{self._topic}")
            for name, view in self.views.items()
        )

    def _search(self) -> None:
        for topic, _ in self._node.get_topic_names_and_types():
            namespace = topic.removesuffix(self._topic)
            is_meant = topic.endswith(self._topic) and self._only in ("", namespace)
            if is_meant and namespace not in self.views and self._node.count_publishers(topic):
                self._listen(namespace)

    @property
    def has_ended(self) -> bool:
        """Whether all nodes of all graphs have gone."""
        return bool(self.views) and not any(
            self._node.count_publishers(f"{namespace}{self._topic}") for namespace in self.views
        )

    def _listen(self, namespace: str) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        from lidar_buildings.ros.diagnostics import SUMMARY, TOPIC
        from lidar_buildings.ros.qos import EVENT

        view = self.views[namespace] = GraphView(self._order)

        def take(message: DiagnosticArray) -> None:
            for status in message.status:
                if status.name.endswith(SUMMARY):
                    with suppress(ValueError):
                        values = {pair.key: float(pair.value) for pair in status.values}
                        level = min(int.from_bytes(status.level, "little"), 2)
                        name = status.name.removesuffix(SUMMARY)
                        view.hear(name, level, status.message, values, time.monotonic())

        self._node.create_subscription(DiagnosticArray, f"{namespace}/{TOPIC}", take, EVENT)


#: Period of the blocks [s].
_PERIOD = 1.0
#: What nodes that were there before are given to say how they get on; they do so once a second [s].
_HEARING = 2.5
_CLEAR = "\x1b[H\x1b[2J"


def top_command(options: argparse.Namespace) -> int:
    """Print a table of the nodes every second, or once; LidarBuildingsError without ROS or a graph."""
    if importlib.util.find_spec("rclpy") is None:
        raise LidarBuildingsError(
            "rclpy is not installed: source a ROS 2 Jazzy workspace, or pip install '.[ros]' in the sources"
        )
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

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
            if listener.has_ended:
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
    is_terminal = sys.stdout.isatty()
    width = shutil.get_terminal_size().columns if is_terminal else None
    lines = []
    for namespace, view in views.items():
        lines += [f"graph {namespace or '/'}", *view.lines(time.monotonic()), ""]
    text = "\n".join(line[:width] for line in lines)
    print(f"{_CLEAR if is_terminal else ''}{text}", flush=True)
