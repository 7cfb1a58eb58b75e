"""``lidar-buildings score``: how well a result agrees with a reference, as a table or as JSON."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lidar_buildings.core.model.errors import InputError, ParameterError

KINDS = ("ground", "buildings", "outlines", "edges", "planes", "models")
#: Default side of a cell [m] and default reach of an empty one [spacings].
CELL, FILL = 0.5, 1.5
#: Cells below the precision of maps, or larger than buildings, say nothing.
CELL_RANGE, FILL_RANGE = (0.05, 100.0), (0.0, 10.0)
#: A disc smaller than the precision of points, or larger than buildings, finds no edges [m].
ALPHA_RANGE = (0.01, 100.0)
#: Default distance within which two corners are the same [m], and its range: maps to buildings.
CORNER_TOLERANCE, CORNER_TOLERANCE_RANGE = 1.0, (0.01, 100.0)
#: The levels of detail of models.
LODS = ("1.2", "1.3", "2.2")
#: Which options apply to which kind.
_OPTIONS = {
    "ground": {"reference_classes"},
    "buildings": {"cell", "fill", "reference_classes"},
    "outlines": {"merge_touching", "corner_tolerance"},
    "edges": {"alpha", "split_steps", "reference_classes"},
    "planes": set(),
    "models": {"lod", "corner_tolerance", "reference_classes"},
}


@dataclass(frozen=True)
class Score:
    """
    What a comparison gave.

    Attributes
    ----------
    figures : dict
        Name → number, unrounded; None for a share or mean of nothing.
    table : str
        The same for reading, one figure a line.
    """

    figures: dict[str, Any]
    table: str


def run_score(
    kind: str,
    result_path: str | Path,
    reference_path: str | Path,
    *,
    aoi: str | Path | None = None,
    cell: float = CELL,
    fill: float = FILL,
    reference_classes: Collection[int] | None = None,
    merge_touching: bool = False,
    alpha: float | None = None,
    split_steps: bool = False,
    corner_tolerance: float = CORNER_TOLERANCE,
    lod: str = LODS[-1],
) -> Score:
    """
    Compare a result with a reference.

    Parameters
    ----------
    kind : str
        ``"ground"``, ``"buildings"``, ``"outlines"``, ``"edges"``, ``"planes"`` or ``"models"``.
    result_path, reference_path : path
        A LAS or LAZ file, a folder of them or the output folder of a run; or a file of polygons. Ground needs
        clouds, outlines need polygons, buildings take either on both sides, edges take either as reference.
        Planes need clouds: with PlaneId, and with TruePlane, PlaneId or colours as reference. Models need
        CityJSON, and CityJSON or clouds as reference.
        Two clouds must hold the same points in the same order.
    aoi : path, optional
        File of polygons: only what lies inside counts.
    cell : float
        Side of the cells in which buildings are compared [m].
    fill : float
        How far an empty cell looks for its nearest point, in point spacings; see `core.scores.cells`.
    reference_classes : collection of int, optional
        The reference's classes of ground (default 2) or of buildings and roofs (default 6).
    merge_touching : bool
        Whether outlines that share a wall are compared as one block, on both sides; see `core.scores.blocks`.
    alpha : float, optional
        Radius of the disc that finds the reference's edges [m]; 1.342 point spacings if not given.
    split_steps : bool
        Whether a step in height parts one roof of the reference from another, and so is an edge.
    corner_tolerance : float
        How far a corner of an outline or of a roof may lie from the one that it stands for [m].
    lod : str
        The finest level of detail that is looked at: ``"1.2"``, ``"1.3"`` or ``"2.2"``.

    Returns
    -------
    Score

    Raises
    ------
    InputError
        If a file cannot be read or the two sides cannot be compared.
    ParameterError
        If the kind or the level is unknown, or `cell`, `fill`, `alpha` or `corner_tolerance` is out of range.
    """
    if kind not in KINDS:
        raise ParameterError(f"score {kind}: must be one of {', '.join(KINDS)}")
    _check_range("cell", cell, *CELL_RANGE)
    _check_range("fill", fill, *FILL_RANGE)
    _check_range("corner-tolerance", corner_tolerance, *CORNER_TOLERANCE_RANGE)
    if alpha is not None:
        _check_range("alpha", alpha, *ALPHA_RANGE)
    if lod not in LODS:
        raise ParameterError(f"score --lod {lod}: must be one of {', '.join(LODS)}")
    # Imported late: --help answers at once.
    from lidar_buildings.evaluation.command.kinds import FIGURES
    from lidar_buildings.evaluation.command.sides import ScoreOptions
    from lidar_buildings.evaluation.command.table import score_table
    from lidar_buildings.evaluation.readers.metric_polygons import read_metric_polygons

    area = None if aoi is None else read_metric_polygons(Path(aoi))
    if area is not None and not len(area.polygons):
        raise InputError(f"{aoi}: holds no polygon: an area of interest needs one")
    options = ScoreOptions(
        area, cell, fill, reference_classes, merge_touching, alpha, split_steps, corner_tolerance, lod
    )
    found = FIGURES[kind](Path(result_path), Path(reference_path), options)
    figures = {name: None if _is_nan(value) else value for name, value in found.items()}
    title = f"{kind}: {result_path} against {reference_path}" + (f" within {aoi}" if aoi else "")
    title += ", touching ones merged into blocks" if merge_touching else ""
    return Score(figures, score_table(title, figures))


def add_score_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe ``lidar-buildings score``."""
    parser.add_argument("kind", type=_kind, metavar="{" + ",".join(KINDS) + "}", help="what to compare")
    parser.add_argument(
        "result", type=Path, metavar="RESULT", help="output folder of a run, LAZ file, GeoPackage or CityJSON"
    )
    parser.add_argument(
        "reference",
        type=Path,
        metavar="REFERENCE",
        help="folder of a survey, LAZ file, GeoPackage or CityJSON",
    )
    parser.add_argument("--aoi", type=Path, metavar="FILE", help="polygons: only what lies inside counts")
    parser.add_argument(
        "--cell", type=float, metavar="M", help=f"buildings: side of a cell [m] (default: {CELL})"
    )
    parser.add_argument(
        "--fill",
        type=float,
        metavar="SPACINGS",
        help=f"buildings: how far an empty cell looks for its nearest point (default: {FILL}; 0: not at all)",
    )
    parser.add_argument(
        "--reference-classes",
        type=_classes,
        metavar="N[,N...]",
        help="all but outlines and planes: the reference's classes of that kind, as in 2,9,11 "
        "(default: 2 or 6)",
    )
    parser.add_argument(
        "--merge-touching",
        action="store_true",
        default=None,
        help="outlines: compare blocks of buildings that share a wall, since lidar cannot tell these apart",
    )
    parser.add_argument(
        "--corner-tolerance",
        type=float,
        metavar="M",
        help="outlines, models: how far a corner may lie from the one that it stands for [m] "
        f"(default: {CORNER_TOLERANCE})",
    )
    parser.add_argument(
        "--alpha",
        type=float,
        metavar="M",
        help="edges: radius of the disc of the reference's alpha shapes [m] (default: 1.342 point spacings)",
    )
    parser.add_argument(
        "--split-steps",
        action="store_true",
        default=None,
        help="edges: let a step in height part one roof of the reference from another",
    )
    parser.add_argument(
        "--lod", choices=LODS, help=f"models: the finest level of detail to look at (default: {LODS[-1]})"
    )
    parser.add_argument("--json", action="store_true", help="print JSON with unrounded numbers")


def score_command(options: argparse.Namespace) -> int:
    """
    Execute ``lidar-buildings score``: print a table or JSON, return 0.

    Raises
    ------
    InputError
        If a file cannot be read or the two sides cannot be compared.
    ParameterError
        If an option is out of range or has no meaning for this kind.
    """
    names = (
        "cell",
        "fill",
        "reference_classes",
        "merge_touching",
        "corner_tolerance",
        "alpha",
        "split_steps",
        "lod",
    )
    given = {name: getattr(options, name) for name in names}
    given = {name: value for name, value in given.items() if value is not None}
    for name in given.keys() - _OPTIONS[options.kind]:
        raise ParameterError(
            f"score {options.kind}: --{name.replace('_', '-')} does not apply to {options.kind}: leave it out"
        )
    score = run_score(options.kind, options.result, options.reference, aoi=options.aoi, **given)
    print(json.dumps({"kind": options.kind, **score.figures}, indent=2) if options.json else score.table)
    return 0


def _kind(text: str) -> str:
    """Check the kind of a score for argparse."""
    if text not in KINDS:
        raise argparse.ArgumentTypeError(f"there is no kind {text!r}: choose {', '.join(KINDS)}")
    return text


def _classes(text: str) -> tuple[int, ...]:
    """Read a list of point classes for argparse."""
    try:
        classes = tuple(int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of classes such as 2,9,11") from None
    if not all(0 <= code <= 255 for code in classes):
        raise argparse.ArgumentTypeError(f"{text!r}: classes are within 0 to 255")
    return classes


def _check_range(name: str, value: float, smallest: float, largest: float) -> None:
    """Raise ParameterError unless the option is a number in its range."""
    if not smallest <= value <= largest:
        raise ParameterError(f"score --{name} {value:g}: must be within {smallest:g} to {largest:g}")


def _is_nan(value: Any) -> bool:
    """Whether a figure is a share or mean of nothing."""
    return isinstance(value, float) and math.isnan(value)
