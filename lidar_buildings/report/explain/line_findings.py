"""The lines of a roof, which tell of houses that touch."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pyogrio

from lidar_buildings.io.results.building_layers import READABLE_ID
from lidar_buildings.io.vectors.polygon_file import read_layer
from lidar_buildings.report.explain.finding import Finding

_LAYER = "roof_lines"
#: As many ridges hint at several houses.
_RIDGES = 2
#: Shorter steps are dormers' and chimneys' [m].
_LONG_STEP = 5.0
_STEPS = ("segmentation.split_at_steps", "segmentation.min_step_height")


def line_findings(path: Path, name: str, unit: float) -> Iterator[Finding]:
    """
    Yield the kinds of roof lines of a building with their number and length.

    Parameters
    ----------
    path : Path
        The GeoPackage.
    name : str
        The building's readable id.
    unit : float
        Metres per unit of length.
    """
    if _LAYER not in {str(layer) for layer, _ in pyogrio.list_layers(path)}:
        return
    columns = read_layer(path, _LAYER).columns
    numbers: Counter[str] = Counter()
    lengths: Counter[str] = Counter()
    for owner, kind, length in zip(columns[READABLE_ID], columns["kind"], columns["length"], strict=True):
        if owner == name:
            numbers[kind] += 1
            lengths[kind] += float(length) * unit
    if not numbers:
        return
    told = (f"{n} {kind} ({lengths[kind]:.1f} m)" for kind, n in numbers.most_common())
    yield Finding(f"Lines: {', '.join(told)}")
    if lengths["step"] >= _LONG_STEP:
        yield Finding(
            f"Steps of {lengths['step']:.1f} m part the roof: maybe buildings that touch, or planes that "
            "should meet.",
            _STEPS,
        )
    elif numbers["ridge"] >= _RIDGES:
        yield Finding(
            f"{numbers['ridge']} ridges: maybe several houses; those of one height that touch are told apart "
            "by --footprints only."
        )
