"""The methods of roof selection as the benchmarks call them, and how their points are scored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.common.tables import percent
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.parameters import spec_of
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs
from lidar_buildings.evaluation.scores.cells import Confusion, confusion_of

#: The methods there are, the default one first.
METHODS = next(spec_of(field).choices for field in fields(RoofSelectionConfig) if field.name == "method")
#: Columns that `point_cells` fills, in percent.
POINT_HEADINGS = ("recall", "precision", "F1")


def roof_mask(
    points: NDArray[np.float64],
    columns: Mapping[str, Any],
    method: str,
    settings: Mapping[str, Any] | None = None,
    *,
    with_facades: bool = True,
) -> NDArray[np.bool_]:
    """Return which points a method takes for building, or for roof alone."""
    config = RoofSelectionConfig(**{**(settings or {}), "method": method})
    found = select_roofs(points, config, **columns)
    is_building = found.classification == PointClass.BUILDING
    return is_building if with_facades else is_building & ~found.is_facade


def point_score(
    mask: NDArray[np.bool_], is_building: NDArray[np.bool_], is_judged: NDArray[np.bool_] | None = None
) -> Confusion:
    """Count agreement point by point, where points are judged."""
    judged = slice(None) if is_judged is None else is_judged
    return confusion_of(mask[judged], is_building[judged])


def point_cells(score: Confusion) -> list[str]:
    """Recall, precision and F1 in percent."""
    return [percent(value) for value in (score.recall, score.precision, score.f1)]


def groups_of(
    places: NDArray[np.float64], mask: NDArray[np.bool_], is_building: NDArray[np.bool_]
) -> tuple[tuple[str, str, NDArray[np.float64]], ...]:
    """Part places into roof in both, found only and missed, with the colours of a map."""
    return (
        ("0.85", "roof in both", places[mask & is_building]),
        ("red", "roof here only", places[mask & ~is_building]),
        ("blue", "roof of the reference only", places[~mask & is_building]),
    )


def method_headings(methods: Sequence[str]) -> dict[str, str]:
    """Return a short name for each method: the first letters of its words."""
    return {"".join(word[0] for word in method.split("_")): method for method in methods}
