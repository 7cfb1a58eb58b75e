"""Tables of plain text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np


def percent(share: float) -> str:
    """Write a share in percent, a dash where there is nothing to take a share of."""
    return "–" if np.isnan(share) else f"{100 * share:.2f}"


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an aligned plain-text table; the first column is flush left."""
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
