"""
Draw what the landings of doc/benchmarks.md took: whole runs of Delft, and their stages.

    python -m bench.pages.landings landings.svg
"""

import sys
import textwrap
from pathlib import Path

from bench.chain.report import LANDING
from bench.common.plotting import plt

#: The picture is drawn of the table with this head.
HEAD = f"| {LANDING[0]} |"
PAGE = Path(__file__).parents[2] / "doc" / "benchmarks.md"


def main(picture: Path) -> None:
    """Draw bars for each landing."""
    # text as text, and the same bytes each time
    plt.rcParams |= {"svg.fonttype": "none", "svg.hashsalt": "landings"}
    landings = table(PAGE.read_text(encoding="utf-8"), HEAD)
    titles = [textwrap.fill(one[LANDING[0]], 36) for one in landings]
    figure, (runs, stages) = plt.subplots(1, 2, figsize=(10, 0.8 * len(landings) + 0.8), sharey=True)
    for shift, name, label in ((-0.2, LANDING[1], "processor time"), (0.2, LANDING[2], "wall time")):
        seconds = [float(one[name]) for one in landings]
        bars = runs.barh([row + shift for row in range(len(landings))], seconds, 0.38, label=label)
        runs.bar_label(bars, fmt="%.1f", padding=2, fontsize=8)
    left = [0.0] * len(landings)
    for stage in LANDING[6:]:
        seconds = [float(one[stage]) for one in landings]
        stages.barh(titles, seconds, left=left, label=stage)
        left = [a + b for a, b in zip(left, seconds, strict=True)]
    runs.set(yticks=range(len(titles)), yticklabels=titles, title="Delft × 1, two cores, all files [s]")
    stages.set(title="stages of it, one core [processor s]")
    for axes in (runs, stages):
        axes.legend(fontsize=8, loc="lower right")
        axes.spines[["top", "right"]].set_visible(False)
    runs.invert_yaxis()
    figure.tight_layout()
    figure.savefig(picture, metadata={"Date": None})


def table(text: str, head: str) -> list[dict[str, str]]:
    """Return the rows of the first table whose head begins so."""
    lines = text[text.index(head) :].partition("\n\n")[0].splitlines()
    names, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    return [dict(zip(names, cells, strict=True)) for cells in rows]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
