"""The command ``lidar-buildings score``: what it is asked for, and what it answers."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import InputError, ParameterError

if TYPE_CHECKING:  # imported late: --help answers at once
    from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons

#: The levels of detail of models.
LODS = ("1.2", "1.3", "2.2")
#: Option → its least and greatest value, from the precision of points and maps to the size of buildings.
_RANGES = {"cell": (0.05, 100.0), "corner_tolerance": (0.01, 100.0)}
#: A result's building points, and a reference's unless told otherwise.
BUILDING = (int(PointClass.BUILDING),)


@dataclass(frozen=True)
class ScoreOptions:
    """The options of all kinds of score; ParameterError if one is out of range or the level unknown."""

    area: MetricPolygons | None = None  #: the area of interest: only what lies inside counts
    cell: float = 0.5  #: side of the cells in which buildings are compared [m]
    #: The reference's classes of ground (default 2) or of buildings and roofs (default 6).
    reference_classes: Collection[int] | None = None
    #: Whether outlines that share a wall are compared as one block; see `evaluation.scores.outlines`.
    merge_touching: bool = False
    #: How far a corner of an outline or of a roof may lie from the one that it stands for [m].
    corner_tolerance: float = 1.0
    lod: str = LODS[-1]  #: the finest level of detail that is looked at: ``"1.2"``, ``"1.3"`` or ``"2.2"``

    def __post_init__(self) -> None:
        for name, (least, greatest) in _RANGES.items():
            value = getattr(self, name)
            if not least <= value <= greatest:
                option = name.replace("_", "-")
                raise ParameterError(f"score --{option} {value:g}: must be within {least:g} to {greatest:g}")
        if self.lod not in LODS:
            raise ParameterError(f"score --lod {self.lod}: must be one of {', '.join(LODS)}")


#: The kinds of comparison, and which options apply to each.
KINDS = {
    "ground": {"reference_classes"},
    "buildings": {"cell", "reference_classes"},
    "outlines": {"merge_touching", "corner_tolerance"},
    "edges": {"reference_classes"},
    "planes": set(),
    "models": {"lod", "corner_tolerance", "reference_classes"},
    "control": {"lod", "reference_classes"},
}


@dataclass(frozen=True)
class Score:
    """What a comparison gave."""

    title: str  #: what was compared with what
    figures: dict[str, Any]  #: name → number, unrounded; None for a share or mean of nothing

    def table(self) -> str:
        """Return the title, and a line for each figure but lists."""
        shown = {name: value for name, value in self.figures.items() if not isinstance(value, list)}
        width = max(map(len, shown))
        return "\n".join([self.title, *(f"  {name:<{width}}  {_text(shown[name]):>10}" for name in shown)])


def run_score(
    kind: str,
    result_path: str | Path,
    reference_path: str | Path,
    *,
    aoi: str | Path | None = None,
    **options: Any,
) -> Score:
    """
    Compare a result with a reference in one of `KINDS`: ground, buildings, outlines, edges, planes, models.

    Either is a LAS or LAZ file, a folder of them or the output folder of a run; or a file of polygons. Ground
    needs clouds, outlines need polygons, buildings take either on both sides, edges take either as reference.
    Planes need clouds: with PlaneId, and with TruePlane, PlaneId or colours as reference. Models need
    CityJSON, and CityJSON or clouds as reference; control needs the folder of a run, and clouds as reference,
    denser ones of the same place. Two clouds of other kinds must hold the same points in the same order.

    Of `aoi`, a file of polygons, only what lies inside counts; `options` are members of `ScoreOptions`.
    InputError if a file cannot be read or the two sides cannot be compared; ParameterError if the kind or an
    option is unknown, or its value out of range.
    """
    if kind not in KINDS:
        raise ParameterError(f"score {kind}: must be one of {', '.join(KINDS)}")
    chosen = ScoreOptions(**options)
    # Imported late: --help answers at once.
    from lidar_buildings.evaluation.command.figures import FIGURES
    from lidar_buildings.evaluation.readers.metric_polygons import read_metric_polygons

    area = None if aoi is None else read_metric_polygons(Path(aoi))
    if area is not None and not len(area.polygons):
        raise InputError(f"{aoi}: contains no polygon: an area of interest needs one")
    found = FIGURES[kind](Path(result_path), Path(reference_path), replace(chosen, area=area))
    figures = {name: _none_for_nan(value) for name, value in found.items()}
    title = f"{kind}: {result_path} against {reference_path}" + (f" within {aoi}" if aoi else "")
    title += ", touching ones merged into blocks" if chosen.merge_touching else ""
    return Score(title, figures)


def add_score_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe ``lidar-buildings score``."""
    add, default = parser.add_argument, ScoreOptions
    kinds = "kind of comparison: one, or several separated by commas"
    add("kinds", type=_kinds, metavar="{" + ",".join(KINDS) + "}", help=kinds)
    what = "LAZ file, GeoPackage or CityJSON"
    add("result", type=Path, metavar="RESULT", help=f"output folder of a run, {what}")
    add("reference", type=Path, metavar="REFERENCE", help=f"folder of a survey, {what}")
    add("--aoi", type=Path, metavar="FILE", help="polygons: count only what lies inside")
    add("--cell", type=float, metavar="M", help=f"buildings: side of a cell [m] (default: {default.cell})")
    classes = "all but outlines and planes: the reference's classes of that kind, as in 2,9,11"
    add("--reference-classes", type=_classes, metavar="N[,N...]", help=f"{classes} (default: 2 or 6)")
    merge = "outlines: compare blocks of buildings that share walls, as lidar cannot separate them"
    add("--merge-touching", action="store_true", default=None, help=merge)
    corner = "outlines, models: largest distance between matching corners [m]"
    corner += f" (default: {default.corner_tolerance})"
    add("--corner-tolerance", type=float, metavar="M", help=corner)
    add(
        "--lod",
        choices=LODS,
        help=f"models, control: finest level of detail to compare (default: {LODS[-1]})",
    )
    add("--json", action="store_true", help="print JSON with unrounded numbers")


def score_command(options: argparse.Namespace) -> int:
    """
    Execute ``lidar-buildings score``: print a table of each kind or JSON, return 0.

    InputError if a file cannot be read or the two sides cannot be compared; ParameterError if an option is
    out of range or has no meaning for this kind.
    """
    names = sorted(set().union(*KINDS.values()))
    given = {name: getattr(options, name) for name in names}
    given = {name: value for name, value in given.items() if value is not None}
    for name in given.keys() - set().union(*(KINDS[kind] for kind in options.kinds)):
        kinds = " or ".join(options.kinds)
        raise ParameterError(
            f"score {kinds}: --{name.replace('_', '-')} does not apply to {kinds}: remove it"
        )
    found = []
    for kind in options.kinds:
        own = {name: value for name, value in given.items() if name in KINDS[kind]}
        score = run_score(kind, options.result, options.reference, aoi=options.aoi, **own)
        found.append({"kind": kind, **score.figures})
        if not options.json:
            print(score.table(), flush=True)
    if options.json:
        print(json.dumps(found if len(found) > 1 else found[0], indent=2))
    return 0


def _kinds(text: str) -> tuple[str, ...]:
    kinds = tuple(text.split(","))
    for kind in kinds:
        if kind not in KINDS:
            raise argparse.ArgumentTypeError(f"there is no kind {kind!r}: choose {', '.join(KINDS)}")
    return kinds


def _classes(text: str) -> tuple[int, ...]:
    try:
        classes = tuple(int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of classes such as 2,9,11") from None
    if not all(0 <= code <= 255 for code in classes):
        raise argparse.ArgumentTypeError(f"{text!r}: classes must be within 0 to 255")
    return classes


def _none_for_nan(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return [_none_for_nan(one) for one in value.tolist()]
    return None if isinstance(value, float) and math.isnan(value) else value


def _text(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.4f}" if isinstance(value, float) else str(value)
