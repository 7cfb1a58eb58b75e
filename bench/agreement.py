"""
Agreement with a reference, and tables of it.

"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from clouds import Cloud
from filters import GroundFilter, ground_mask
from numpy.typing import NDArray

from lidar_buildings.evaluation.scores.ground import GroundScore, score_ground

#: Heading → member of GroundScore, and whether it is shown in percent.
FIGURES = (("total", "total_error"), ("type I", "type_1_error"), ("type II", "type_2_error"))


def score_of_mask(mask: NDArray[np.bool_], is_ground: NDArray[np.bool_]) -> GroundScore:
    """
    Score a filter's ground against the reference's.

    """
    return score_ground(np.where(mask, 2, 1), np.where(is_ground, 2, 1))


def score_of(ground_filter: GroundFilter, cloud: Cloud) -> GroundScore:
    """
    Run a filter and score it.

    """
    return score_of_mask(ground_mask(ground_filter, cloud), cloud.is_ground)


def cells_of(score: GroundScore) -> list[str]:
    """
    Total, type I and type II error in percent, and kappa in percent.

    """
    shares = [*(getattr(score, member) for _, member in FIGURES), score.kappa]
    return [percent(share) for share in shares]


def mean_cells(scores: Sequence[GroundScore]) -> list[str]:
    """
    Return the means over clouds, each cloud weighing the same.

    """
    members = [*(member for _, member in FIGURES), "kappa"]
    return [percent(float(np.nanmean([getattr(s, member) for s in scores]))) for member in members]


def percent(share: float) -> str:
    """
    Write a share in percent, a dash where there is nothing to take a share of.

    """
    return "–" if np.isnan(share) else f"{100 * share:.2f}"


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """
    Return an aligned plain-text table; the first column is flush left.

    """
    lines = [list(headings), *(list(row) for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(headings))]
    text = [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([text[0], "  ".join("-" * width for width in widths), *text[1:]])


#: Headings of the four columns that `cells_of` and `mean_cells` fill, all in percent.
SCORE_HEADINGS = ("total %", "type I %", "type II %", "kappa %")
