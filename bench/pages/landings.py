"""
Draw what the landings of doc/benchmarks.md took: whole runs of Delft, and their stages.

    python -m bench.pages.landings doc/landings.svg
"""

import re
import sys
import textwrap
from pathlib import Path

from bench.common.plotting import plt

PAGE = Path(__file__).parents[2] / "doc" / "benchmarks.md"
STAGES = (
    *("ground filter", "roof selection", "edge labelling", "segmentation and tracing", "regularisation"),
    *("plane fitting", "models"),
)
#: Heads of the tables, and how the row of a run on both cores begins.
RUN, STAGE, DELFT = "| run | cores | tiles", "| stage | Delft, tile 1", ["Delft × 1", "2"]


def main(picture: Path) -> None:
    """Draw a bar for each landing that has both tables."""
    # text as text, and the same bytes each time
    plt.rcParams |= {"svg.fonttype": "none", "svg.hashsalt": "landings"}
    landings = [one for one in read_landings(PAGE.read_text(encoding="utf-8")) if one[1] and one[2]]
    titles = [title for title, _, _ in landings]
    figure, (runs, stages) = plt.subplots(1, 2, figsize=(10, 0.8 * len(landings) + 0.8), sharey=True)
    for shift, name, label in ((-0.2, "CPU s", "processor time"), (0.2, "wall s", "wall time")):
        seconds = [run[name] for _, run, _ in landings]
        bars = runs.barh([row + shift for row in range(len(landings))], seconds, 0.38, label=label)
        runs.bar_label(bars, fmt="%.1f", padding=2, fontsize=8)
    left = [0.0] * len(landings)
    for stage in STAGES:
        seconds = [one[stage] for _, _, one in landings]
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


def read_landings(text: str) -> list[tuple[str, dict[str, float], dict[str, float]]]:
    """Return (title, seconds of the run, by stage) of each landing; empty where it has no such table."""
    whole = text.partition("\n## The whole chain\n")[2]
    _, *parts = re.split(r"^### ", whole, flags=re.MULTILINE)
    landings = []
    for part in parts:
        title = textwrap.fill(part.partition("\n")[0], 36)
        runs = [dict(zip(*one, strict=True)) for one in table(part, RUN)]
        delft = next((one for one in runs if [one["run"], one["cores"]] == DELFT), {})
        run = {name: float(delft[name]) for name in ("CPU s", "wall s") if delft}
        rows = [dict(zip(*one, strict=True)) for one in table(part, STAGE)]
        landings.append((title, run, {row["stage"]: float(row["Delft: CPU s"]) for row in rows}))
    return landings


def table(text: str, head: str) -> list[tuple[list[str], list[str]]]:
    """Return (names, cells) of each row of the first table whose head begins so."""
    lines = text[text.index(head) :].partition("\n\n")[0].splitlines() if head in text else []
    names, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines] or [[], []]
    return [(names, cells) for cells in rows]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
