"""The running graph as text, from what its nodes say. It needs no ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from lidar_buildings.ros.node_summary import OK
from lidar_buildings.ros.tile_ledger import IN_HAND, NodeState

#: A node that has not been heard for so long is said to be silent [s]; wide margin: each speaks once a second
#: unless it is at work.
_SILENT = 5.0
_LEVELS = ("ok", "WARN", "ERROR")
_HEAD = ("node", "state", "in", "out", "in hand", "points/s", "last tile", "input", "level", "message")
#: Columns of words; those of numbers are aligned to the right.
_WORDS = {"node", "state", "level", "message"}


@dataclass
class _Node:
    """What is known of a node."""

    in_hand: set[int] = field(default_factory=set)
    heard: float = 0.0
    told: float = 0.0
    level: int = OK
    message: str = ""
    values: Mapping[str, float] = field(default_factory=dict)


class GraphView:
    """What the nodes of one namespace said last, in an order of names; others come after these, by name."""

    def __init__(self, order: Sequence[str] = ()) -> None:
        self._nodes: dict[str, _Node] = {}
        self._order = order

    @property
    def has_all(self) -> bool:
        """Whether every node that has been heard of has said how it gets on."""
        return bool(self._nodes) and all(one.values for one in self._nodes.values())

    def hear_state(self, state: NodeState, now: float) -> None:
        """Note that a node is there, and which tiles it has in hand."""
        one = self._nodes.setdefault(state.node, _Node())
        one.in_hand = {stamp for stamp, of in state.tiles.items() if of.status == IN_HAND}
        one.heard = now

    def hear_summary(
        self, node: str, level: int, message: str, values: Mapping[str, float], now: float
    ) -> None:
        """Note how a node gets on."""
        one = self._nodes.setdefault(node, _Node())
        one.level, one.message, one.values = level, message, values
        one.heard = one.told = now

    def lines(self, now: float) -> list[str]:
        """Return a table of the nodes, and what is known of tiles and buildings beneath."""
        nodes = sorted(self._nodes.items(), key=lambda pair: (self._place_of(pair[0]), pair[0]))
        rows = [_HEAD, *(_row(name, one, now) for name, one in nodes)]
        widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD))]
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
    """Return what is known of a node, a text for each column."""
    values = one.values
    if one.in_hand:
        state = "at work"
    else:
        state = "idle" if now - one.heard < _SILENT else f"silent {now - one.heard:.0f} s"
    busy = values.get("seconds", 0.0)
    has_rate = busy > 0 and values.get("points_in") and "tiles_in_flight" not in values  # no source
    rate = f"{values['points_in'] / busy:,.0f}" if has_rate else "-"
    age = f"{values['input_age'] + now - one.told:.0f} s" if "input_age" in values else "-"
    last = values.get("seconds_last_tile", 0.0)
    return (
        name,
        state,
        f"{values.get('tiles_in', 0):,.0f}" if values else "-",
        f"{values.get('tiles_out', 0):,.0f}" if values else "-",
        f"{len(one.in_hand)}",
        rate,
        f"{last:.2f} s" if last else "-",
        age,
        _LEVELS[one.level] if values else "-",
        one.message if one.level or not one.in_hand else f"tile {min(one.in_hand)}",
    )


def _more(name: str, values: Mapping[str, float]) -> list[str]:
    """Return what a node counts beside what all do."""
    lines = []
    if "tiles_in_flight" in values:
        lines.append(
            f"{name}: {values['tiles_done']:,.0f} tiles done, {values['tiles_in_flight']:.0f} in flight, "
            f"{values['tiles_given_up']:,.0f} given up; the last took {values['latency']:.1f} s"
        )
    if "points_waiting" in values:
        left_out = sum(n for key, n in values.items() if key.startswith("left out"))
        lines.append(
            f"{name}: {values['scans']:,.0f} scans, {values['points']:,.0f} points kept, "
            f"{values['points_waiting']:,.0f} to be placed, {left_out:,.0f} left out; "
            f"{values['tiles_waiting']:,.0f} tiles queued"
        )
    buildings = {
        key.removeprefix("buildings").strip("_"): n
        for key, n in values.items()
        if key.startswith("buildings")
    }
    if buildings:
        counts = ", ".join(f"{n:,.0f} {status}".rstrip() for status, n in sorted(buildings.items()))
        lines.append(f"{name}: buildings: {counts}")
    return lines
