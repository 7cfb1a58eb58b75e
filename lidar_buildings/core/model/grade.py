"""How far a building's model can be trusted, and what speaks against it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from enum import Enum


class Grade(str, Enum):
    """How far a model can be trusted."""

    #: Nothing speaks against it.
    GOOD = "good"
    #: It may be wrong: look at it before it is used.
    CHECK = "check"
    #: It is wrong, or there is none.
    POOR = "poor"


class Cause(str, Enum):
    """What speaks against a model: the codes of `quality_reasons` (doc/quality.md)."""

    #: There is no solid: too few points, checks that failed, or an unexpected error.
    NO_MODEL = "no_model"
    #: The building reaches the edge of the data.
    CUT_OFF = "cut_off"
    #: The outline could not be made regular.
    TRACED_OUTLINE = "traced_outline"
    #: The finest level of detail is coarser than LoD2.2.
    COARSE_LEVEL = "coarse_level"
    #: The roof lies off its points, which are one surface.
    OFF_POINTS = "off_points"
    #: The roof's points are scattered about it, as those of branches and of noise.
    SCATTERED = "scattered"
    #: Large parts of the outline have no points.
    NO_POINTS = "no_points"
    #: On parts of the footprint the ground was seen.
    ON_GROUND = "on_ground"
    #: The roof goes on beside the footprint.
    TOO_NARROW = "too_narrow"
    #: Points are too far apart to tell where a building of this size ends.
    SPARSE = "sparse"


@dataclass(frozen=True)
class Doubt:
    """One thing that speaks against a model."""

    cause: Cause
    text: str  #: what was found, with its number
    grade: Grade = Grade.CHECK  #: CHECK or POOR


def grade_of(doubts: Iterable[Doubt]) -> Grade:
    """Return the grade of a model with these doubts."""
    grades = {doubt.grade for doubt in doubts}
    return next((grade for grade in (Grade.POOR, Grade.CHECK) if grade in grades), Grade.GOOD)


def reasons_of(doubts: Iterable[Doubt]) -> str:
    """Write doubts as the attribute `quality_reasons` has them: ``code: text; code: text``."""
    return "; ".join(f"{doubt.cause.value}: {doubt.text}" for doubt in doubts)


def grade_attributes(doubts: Collection[Doubt]) -> dict[str, str]:
    """Return what files say of the doubts about a building."""
    return {"quality": grade_of(doubts).value, "quality_reasons": reasons_of(doubts)}


def causes_in(reasons: str) -> list[str]:
    """Return the codes in a text of `reasons_of`."""
    return [one.partition(": ")[0] for one in reasons.split("; ") if one]
