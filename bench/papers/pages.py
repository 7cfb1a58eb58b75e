"""The measured tables of `doc/papers/*.md`, each between two comments that name it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.common.clouds import ROOT

#: Where the pages are, one a paper.
PAGES = ROOT / "doc" / "papers"


class Section(NamedTuple):
    """A table, and what is said below it."""

    name: str  #: of its place in the page
    text: str  #: Markdown


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def places_in(page: str) -> list[str]:
    """Name the places of a page in order; ValueError if one has no end."""
    begins = re.findall(r"<!-- measured: ([\w-]+),[^>]*-->", page)
    ends = re.findall(r"<!-- end: ([\w-]+) -->", page)
    if begins != ends:
        raise ValueError(f"places {begins} begin, {ends} end: each needs both comments")
    return begins


def filled(page: str, sections: Iterable[Section]) -> str:
    """Return a page with these sections in their places; ValueError if one has none."""
    places = places_in(page)
    for name, text in sections:
        if name not in places:
            raise ValueError(f"{name}: the page has no place of this name, only {', '.join(places)}")
        pattern = rf"(<!-- measured: {name},[^>]*-->\n).*?(<!-- end: {name} -->)"
        page = re.sub(pattern, lambda found, text=text: f"{found[1]}\n{text}\n\n{found[2]}", page, flags=re.S)
    return page


def write(paper: str, sections: Iterable[Section], folder: Path = PAGES) -> None:
    """Write sections into the page of a paper."""
    path = folder / f"{paper}.md"
    path.write_text(filled(path.read_text(encoding="utf-8"), sections), encoding="utf-8")


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Write mean, median and root mean square of some values."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if not len(known):
        return "–"
    figures = (known.mean(), np.median(known), np.sqrt((known**2).mean()))
    return " / ".join(f"{figure:.{digits}f}" for figure in figures)
