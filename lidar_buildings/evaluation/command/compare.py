"""``lidar-buildings compare``: what has changed between two results of one place."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

#: File of the changes, in the new result's folder unless another is named.
CHANGES = "changes.gpkg"


def add_compare_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe ``lidar-buildings compare``."""
    add = parser.add_argument
    add("old", type=Path, metavar="OLD", help="output folder of the earlier run")
    add("new", type=Path, metavar="NEW", help="output folder of the later one")
    add("--output", type=Path, metavar="FILE", help=f"GeoPackage of the changes (default: NEW/{CHANGES})")
    height = "least change of a roof's elevation, or four standard deviations of what has not changed"
    add("--min-height", type=float, default=0.5, metavar="M", help=f"{height} [m] (default: 0.5)")
    add("--min-area", type=float, default=4.0, metavar="M2", help="least part of a roof [m²] (default: 4)")
    add("--json", action="store_true", help="print JSON with a row per change")


def compare_command(options: argparse.Namespace) -> int:
    """
    Execute ``lidar-buildings compare``: write the changes, print them, return 0.

    InputError if one of both is no output folder of a run, or they do not fit together; OutputError if the
    file cannot be written; ParameterError if a limit is out of range.
    """
    # Imported late: --help answers at once.
    from lidar_buildings.evaluation.changes import ChangeConfig, compare_runs

    config = ChangeConfig(min_height=options.min_height, min_area=options.min_area)
    found = compare_runs(options.old, options.new, config)
    path = options.output or options.new / CHANGES
    found.write(path)
    rows, totals = (
        found.rows(),
        Counter(found.words[1]) + Counter(word for word in found.words[0] if word == "gone"),
    )
    if options.json:
        told = {
            "offset": found.offset,
            "scatter": found.scatter,
            "cell": found.cell,
            "buildings": dict(totals),
        }
        print(json.dumps({**told, "changes": rows}, indent=2))
        return 0
    print(
        f"{len(found.old.polygons)} buildings before, {len(found.new.polygons)} now; NEW lies "
        f"{found.offset:+.3f} m higher,"
    )
    print(f"single cells of {found.cell:g} m that have not changed scatter by {found.scatter:.3f} m")
    print("buildings: " + (", ".join(f"{n} {word}" for word, n in sorted(totals.items())) or "none"))
    for row in rows:
        print(_line(row))
    print(f"  {path}")
    return 0


def _line(row: dict[str, Any]) -> str:
    names = [f"{side} {row[f'{side}_id']}" for side in ("old", "new") if row[f"{side}_id"] is not None]
    size = f"{row['area']:.0f} m², {row['height_change']:+.2f} ± {row['height_sigma']:.3f} m"
    return f"  {row['change']:13s} {size:28s} {100 * row['share']:3.0f} % of it   {', '.join(names)}"
