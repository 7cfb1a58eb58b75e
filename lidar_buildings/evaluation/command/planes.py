"""The score of planes: a result's planes against a reference's, point by point."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.evaluation.command.options import ScoreOptions, check_same_system, is_inside
from lidar_buildings.evaluation.readers.plane_labels import PlaneLabels, read_plane_labels
from lidar_buildings.evaluation.scores.planes import PlaneScore, planes_of_colours, score_planes
from lidar_buildings.evaluation.scores.statistics import mean

#: Figures that are given for each cloud, too.
PER_CLOUD = ("precision", "recall", "f1", "weighted_coverage")


def plane_figures(result: Path, reference: Path, options: ScoreOptions) -> dict[str, Any]:
    """Compare planes of all clouds together, and cloud by cloud: a cloud may be a roof."""
    clouds = [_labels(cloud, options) for cloud in read_plane_labels(result, reference)]
    scores = [score_planes(mine, theirs) for _, mine, theirs in clouds]
    together = score_planes(
        _joined([mine for _, mine, _ in clouds]), _joined([theirs for _, _, theirs in clouds])
    )
    return {
        "n_points": together.n_points,
        "n_planes_result": together.n_result,
        "n_planes_reference": together.n_reference,
        "n_planes_found": together.n_found,
        **{name: getattr(together, name) for name in (*PER_CLOUD, "coverage")},
        "n_clouds": len(clouds),
        **{f"mean_{name}": _mean(scores, name) for name in PER_CLOUD},
        "clouds": [name for name, _, _ in clouds],
        **{f"{name}_per_cloud": [getattr(score, name) for score in scores] for name in PER_CLOUD},
    }


def _labels(cloud: PlaneLabels, options: ScoreOptions) -> tuple[str, NDArray[np.int64], NDArray[np.int64]]:
    """Return a cloud's name and the planes of both sides within the area of interest, numbered from 1."""
    check_same_system(cloud.crs, "", options.area)
    inside = is_inside(cloud.points, options.area)
    theirs = planes_of_colours(cloud.points, cloud.reference) if cloud.by_colour else cloud.reference
    return cloud.name, _numbered(cloud.result[inside]), _numbered(theirs[inside])


def _numbered(labels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number planes from 1 on; what is none stays as it is."""
    number = np.searchsorted(np.unique(labels[labels > 0]), labels) + 1
    return np.where(labels > 0, number, labels)


def _joined(parts: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Join the labels of clouds; planes of different clouds are different ones."""
    starts = np.cumsum([0] + [int(part.max(initial=0)) for part in parts])
    shifted = [np.where(part > 0, part + start, part) for part, start in zip(parts, starts[:-1], strict=True)]
    return np.concatenate([np.empty(0, dtype=np.int64), *shifted])


def _mean(scores: list[PlaneScore], name: str) -> float:
    values = np.array([getattr(score, name) for score in scores], dtype=np.float64)
    return mean(values[np.isfinite(values)])
