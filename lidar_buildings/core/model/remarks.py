"""Remarks: one line each about what a survey or a run says that can hardly be so, or what it lacks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from lidar_buildings.core.model.errors import printable


@dataclass(frozen=True)
class Remark:
    """
    One line for a person who is to look at a survey or a run, and a word for a script.

    A remark is no error: the run goes on. What a file says when it is opened is in `Cloud.remarks`, goes with
    the file into a run, and stands in `RunSummary.remarks`: in ``run.json``, in the report, in the terminal.
    """

    code: str  #: what it is about, in lower case with underscores; stable, for scripts
    text: str  #: what, why and what to do, in one line

    def __post_init__(self) -> None:
        """Escape what names of files may hold."""
        object.__setattr__(self, "text", printable(self.text))

    def __str__(self) -> str:
        """Return the line."""
        return self.text


def gathered(remarks: Iterable[Remark], most: int = 3) -> tuple[Remark, ...]:
    """Return each remark once, in their order; of a code at most so many, the last with how many more."""
    of_code: dict[str, list[Remark]] = {}
    for one in dict.fromkeys(remarks):
        of_code.setdefault(one.code, []).append(one)
    kept: list[Remark] = []
    for code, alike in of_code.items():
        kept += alike[:most]
        if len(alike) > most:
            kept[-1] = Remark(code, f"{kept[-1].text} (and {len(alike) - most:,} more like this)")
    return tuple(kept)
