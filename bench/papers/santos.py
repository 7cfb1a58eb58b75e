"""Santos, Galo and others: Table 1 and Figures 2, 3 and 7."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bench.common.areas import areas_in
from bench.common.tables import table
from bench.edges.run import FIGURES, METHODS, PUBLISHED, rows_of, scores_of
from bench.papers import cube
from bench.papers.presets import config_of


def report(data: Path, folder: Path | None) -> None:
    """Print the tables; draw the figures into a folder if one is given."""
    print("Table 1, on a cube of our own (Figure 2):")
    print(cube.table_1())
    published = config_of("santos").edge_labelling
    configs = {method: replace(published, **setting) for method, setting in METHODS.items()}
    scores = scores_of(areas_in(data), configs)
    print("\nFigure 7, as numbers [%]:")
    print(table(("method", "area", *FIGURES.values()), rows_of(scores)))
    print(f"\n{PUBLISHED}\n")
    if folder is not None:
        from bench.edges.plot import draw_scores

        cube.draw(folder)
        draw_scores(folder / "santos_figure_7.png", {"published": scores})
