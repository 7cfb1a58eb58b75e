"""Agreement with a reference's ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.common.clouds import Cloud
from bench.common.tables import percent
from bench.ground.methods import ground_mask
from lidar_buildings.evaluation.scores.cells import Confusion, score_ground

#: Heading → member of Confusion, and whether it is shown in percent.
FIGURES = (("total", "total_error"), ("type I", "type_1_error"), ("type II", "type_2_error"))


def score_of_mask(mask: NDArray[np.bool_], is_ground: NDArray[np.bool_]) -> Confusion:
    """Score a filter's ground against the reference's."""
    return score_ground(np.where(mask, 2, 1), np.where(is_ground, 2, 1))


def score_of(cloud: Cloud, method: str, settings: Mapping[str, Any] | None = None) -> Confusion:
    """Run a method and score it."""
    return score_of_mask(ground_mask(cloud, method, settings), cloud.is_ground)


def cells_of(score: Confusion) -> list[str]:
    """Total, type I and type II error in percent, and kappa in percent."""
    shares = [*(getattr(score, member) for _, member in FIGURES), score.kappa]
    return [percent(share) for share in shares]


def mean_cells(scores: Sequence[Confusion]) -> list[str]:
    """Return the means over clouds, each cloud weighing the same."""
    members = [*(member for _, member in FIGURES), "kappa"]
    return [percent(float(np.nanmean([getattr(s, member) for s in scores]))) for member in members]


def draw_errors(folder: Path | None, method: str, name: str, cloud: Cloud, mask: NDArray[np.bool_]) -> None:
    """Draw a cloud's disagreements into the folder, if there is one; matplotlib is needed only for this."""
    if folder is None:
        return
    from bench.common.pictures import draw_over_relief

    total, type_1, type_2, _ = cells_of(score_of_mask(mask, cloud.is_ground))
    title = f"{name}, {method}: total {total} %, type I {type_1} %, type II {type_2} %"
    groups = (
        ("red", "type I: ground taken for object", cloud.points[cloud.is_ground & ~mask]),
        ("blue", "type II: object taken for ground", cloud.points[~cloud.is_ground & mask]),
    )
    draw_over_relief(folder / f"{name}_{method}.png", cloud.points, groups, title)


#: Headings of the four columns that `cells_of` and `mean_cells` fill, all in percent.
SCORE_HEADINGS = ("total %", "type I %", "type II %", "kappa %")
