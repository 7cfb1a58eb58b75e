"""The tables of a landing, as plain text or as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bench.chain.stages import DECODING, EDGES, GROUND, MODELS, OUTLINES, PLANES, ROOFS, TRACING
from bench.common.tables import table

Records = dict[str, list[dict[str, Any]]]
Rows = list[list[str]]

#: Heads the tables of the last landing in a document; behind it stands which one that is.
LAST = "\n### Last measured: "
#: Columns of the table of all landings: seconds of whole runs, points a second, and stages [processor s].
LANDING = (
    *("landing", "Delft × 1: CPU s", "wall s", "wall s, ROS", "Delft × 16: M points/s", DECODING),
    *(GROUND, ROOFS, EDGES, TRACING, OUTLINES, PLANES, MODELS),
)
#: The stages' input that counts for it.
DELFT = "Delft"
#: What is said of roofer; the source was not found, and neither the machine nor its cores are known.
ROOFER_SAID = ("roofer, as stated by others", 160, 588, 2.33)


class Table:
    """A heading, what the columns are, the rows, and what could not be measured (`missing`), and why."""

    def __init__(self, title: str, headings: Sequence[str], rows: Rows, missing: Sequence[str] = ()) -> None:
        self.title, self.headings, self.rows, self.missing = title, headings, rows, missing

    def plain(self) -> str:
        """Return it for a terminal."""
        return "\n".join([f"{self.title}:", table(self.headings, self.rows), *self.missing])

    def markdown(self) -> str:
        """Return it for a document."""
        head, *text = (f"| {' | '.join(line)} |" for line in (self.headings, *self.rows))
        text = [head, f"|---|{'--:|' * (len(self.headings) - 1)}", *text]
        return "\n".join([f"{self.title}:", "", *text, *(f"\n{line}" for line in self.missing)])


def tables_of(records: Records) -> list[Table]:
    """Return the tables of those parts that were measured."""
    made = {"runs": runs_table, "stages": stages_table, "peers": models_table, "start": start_table}
    ordered = {
        "runs": [*records.get("runs", []), *records.get("village", [])],
        "stages": records.get("stages", []),
        "peers": [*records.get("stages", []), *records.get("peers", [])],
        "start": [*records.get("start", []), *records.get("latency", [])],
    }
    return [make(ordered[part]) for part, make in made.items() if ordered[part]]


def landed(text: str, title: str, records: Records) -> str:
    """
    Return a document with a landing's line at the end of the table before `LAST`, and its tables behind.

    A landing that lacks the whole run of Delft, or its stages, has no line.
    """
    before, mark, _ = text.partition(LAST)
    if not mark:
        raise ValueError(f"{title}: the document has no heading {LAST.strip()!r}")
    line = landing_line(title, records)
    before = f"{before.rstrip()}\n" + (f"| {' | '.join(line)} |\n" if line else "")
    return "\n\n".join([f"{before}{LAST}{title}", *(one.markdown() for one in tables_of(records))]) + "\n"


def landing_line(title: str, records: Records) -> list[str]:
    """Return the cells of a landing, as `LANDING` names them; none where they were not measured."""
    runs = {(one["name"], one["is_ros"]): one for one in records.get("runs", ()) if one.get("cores") == 2}
    cpu = next((one["cpu"] for one in records.get("stages", ()) if one["name"] == DELFT), None)
    plain, ros = (runs.get(("Delft × 1", is_ros)) for is_ros in (False, True))
    many = runs.get(("Delft × 16", False))
    if plain is None or cpu is None:
        return []
    return [
        *(title, f"{plain['cpu']:.1f}", f"{plain['wall']:.1f}", "" if ros is None else f"{ros['wall']:.1f}"),
        "" if many is None else f"{many['points'] / many['wall'] / 1e6:.3f}",
        *(f"{cpu[stage]:.2f}" for stage in LANDING[5:]),
    ]


def runs_table(records: Sequence[dict[str, Any]]) -> Table:
    """Return a line per run of the whole chain."""
    headings = (
        *("run", "cores", "tiles", "points", "CPU s", "wall s", "M points/s", "CPU × decoding"),
        *(
            "wall × decoding",
            "wall, ROS / ROS-free",
            "CPU, ROS / ROS-free",
            "memory MB",
            "temporary MB",
            "others' CPU s",
        ),
    )
    there = [one for one in records if "missing" not in one]
    without = {(one["name"], one["cores"]): one for one in there if not one["is_ros"]}

    def row(one: dict[str, Any]) -> list[str]:
        plain = without.get((one["name"], one["cores"])) if one["is_ros"] else None
        return [
            one["name"] + (", ROS" if one["is_ros"] else ""),
            *(str(one["cores"]), str(one["tiles"]), f"{one['points']:,}"),
            *(f"{one['cpu']:.1f}", f"{one['wall']:.1f}", f"{one['points'] / one['wall'] / 1e6:.3f}"),
            *(f"{one[name] / one[f'decoding_{name}']:.0f}" for name in ("cpu", "wall")),
            *("" if plain is None else f"{one[name] / plain[name]:.2f}" for name in ("wall", "cpu")),
            *(f"{one[name] / 1e6:.0f}" for name in ("memory", "disk")),
            f"{one['others']:.1f}",
        ]

    return Table("Whole runs with all files", headings, [row(one) for one in there], _missing(records))


def stages_table(records: Sequence[dict[str, Any]]) -> Table:
    """Return a line per stage: processor seconds on one core, and points per second."""
    there = [one for one in records if "cpu" in one]
    names = list(dict.fromkeys(stage for one in there for stage in (DECODING, *one["cpu"])))

    def cells(one: dict[str, Any], seconds: float | None) -> list[str]:
        return ["", ""] if seconds is None else [f"{seconds:.2f}", f"{one['points'] / seconds / 1e6:.2f}"]

    rows = [[stage, *(c for one in there for c in cells(one, one["cpu"].get(stage)))] for stage in names]
    sums: dict[str, Callable[[dict[str, float]], float]] = {
        "raw points to building class": lambda cpu: cpu[GROUND] + cpu[ROOFS],
        "all stages": lambda cpu: sum(cpu.values()) - cpu.get(DECODING, 0.0),
    }
    rows += [[name, *(c for one in there for c in cells(one, add(one["cpu"])))] for name, add in sums.items()]
    headings = ["stage", *(text for one in there for text in (f"{one['name']}: CPU s", "M points/s"))]
    return Table("Stages, one core", headings, rows, _missing(records))


def models_table(records: Sequence[dict[str, Any]]) -> Table:
    """Return a line per cloud and peer: buildings and roof faces per second on one core."""
    headings = ("buildings of", "buildings", "roof faces", "CPU s", "buildings/s", "faces/s")
    rows = []
    for one in records:
        if "buildings" in one and isinstance(one["cpu"], dict):
            for name, parts in (("models", (MODELS,)), ("planes and models", (PLANES, MODELS))):
                seconds = sum(one["cpu"][part] for part in parts)
                rows.append(_models_row(f"{one['name']}: {name}", one["buildings"], one["faces"], seconds))
        elif "buildings" in one:
            rows.append(_models_row(f"{one['name']}: all", one["buildings"], one["faces"], one["cpu"]))
    return Table("Models", headings, [*rows, _models_row(*ROOFER_SAID)], _missing(records))


def start_table(records: Sequence[dict[str, Any]]) -> Table:
    """Return lines of the first run and of the latency."""
    by_name = {one["name"]: one for one in records if "missing" not in one}
    rows: Rows = []
    if "first" in by_name and "second" in by_name:
        first, second = by_name["first"], by_name["second"]
        rows = [
            ["demo, nothing compiled before", *_times(first), str(first["compiled"])],
            ["demo, once more", *_times(second), str(second["compiled"])],
            ["compiling: the difference", *(f"{first[n] - second[n]:.1f}" for n in ("wall", "cpu")), "", ""],
        ]
    if "latency" in by_name:
        one = by_name["latency"]
        name = f"last point to last model, {one['points']:,} points"
        rows.append(
            [name, f"{np.median(one['seconds']):.2f}", f"{one['cpu']:.1f}", f"{one['others']:.1f}", ""]
        )
    headings = ("", "wall s", "CPU s", "others' CPU s", "loops compiled")
    return Table("Start and latency", headings, rows, _missing(records))


def _times(one: dict[str, Any]) -> list[str]:
    return [f"{one[name]:.1f}" for name in ("wall", "cpu", "others")]


def _models_row(name: str, buildings: int, faces: int, seconds: float) -> list[str]:
    rates = (f"{buildings / seconds:.1f}", f"{faces / seconds:.0f}")
    return [name, str(buildings), str(faces), f"{seconds:.2f}", *rates]


def _missing(records: Sequence[dict[str, Any]]) -> list[str]:
    """Say what was not measured."""
    return [
        f"Not measured: {one.get('name', one.get('key'))}: {one['missing']}."
        for one in records
        if "missing" in one
    ]
