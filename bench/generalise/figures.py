"""What a part's scores come to: per disturbance the mean and the mean of the worst tenth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bench.common.tables import percent

#: Headings of the columns of `figures_of`.
FIGURE_HEADINGS = ("n", "mean %", "worst tenth %", "worst %", "worst case")


class Score(NamedTuple):
    """One figure of one disturbed cloud."""

    #: Which cloud, and how it was disturbed (a key of `disturbances.KINDS`, or ``plain``).
    case: str
    kind: str
    value: float  #: the figure, a share; NaN where there is nothing to judge


def worst_tenth(values: Sequence[float], higher_is_better: bool = False) -> float:
    """Return the mean of the worst tenth, one value at least."""
    rising = np.sort(values)
    rising = rising if higher_is_better else rising[::-1]
    return float(rising[: math.ceil(len(rising) / 10)].mean()) if len(rising) else math.nan


def figures_of(scores: Sequence[Score], higher_is_better: bool = False) -> list[str]:
    """Return the cells of a line: number, mean, worst tenth, worst and where."""
    known = [score for score in scores if not math.isnan(score.value)]
    values = [score.value for score in known]
    if not known:
        return ["0", *4 * "–"]
    worst = (min if higher_is_better else max)(known, key=lambda score: score.value)
    tenth = worst_tenth(values, higher_is_better)
    return [
        str(len(known)),
        percent(float(np.mean(values))),
        percent(tenth),
        percent(worst.value),
        worst.case,
    ]


def rows_of(name: str, scores: Sequence[Score], higher_is_better: bool = False) -> Iterator[list[str]]:
    """Yield lines: one per kind of disturbance, and one of all that are disturbed."""
    kinds: Mapping[str, None] = dict.fromkeys(score.kind for score in scores)
    for kind in kinds:
        yield [name, kind, *figures_of([s for s in scores if s.kind == kind], higher_is_better)]
    disturbed = [score for score in scores if score.kind != "plain"]
    yield [name, "all disturbed", *figures_of(disturbed, higher_is_better)]
