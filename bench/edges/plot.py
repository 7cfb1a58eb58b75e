"""The scores of edge labelling as bars, after Figure 7 of Santos, Galo and others."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from PIL import Image

from bench.common.plotting import plt
from lidar_buildings.evaluation.scores.cells import Figures

#: Class → title, and what the paper's text says of its figures: least, greatest and mean [%].
CLASSES = {"edge": ("edges", (61.0, 98.0, 79.0)), "non_edge": ("other points", (92.0, 100.0, 97.0))}
#: Rows of the plot.
FIGURES = {"completeness": "completeness", "correctness": "correctness", "f_score": "F-score"}
#: Method → name in the legend, and colour.
LOOKS = {
    "k_means_eigenvalues": ("k-means, λ1 λ2 λ3", "#5b7fa6"),
    "k_means_linearity_planarity": ("k-means, L P", "#c8472f"),
    "k_means_linearity": ("k-means, L", "#e0a458"),
    "discriminant_analysis": ("discriminant analysis", "#7a8b69"),
    "rims_alone": ("control: rims alone, no features", "#b9bcc4"),
}
VARIANTS = {"published": "as published", "default": "thinned (default)"}


def draw_scores(path: Path, scores: Mapping[str, Mapping[str, Mapping[str, Figures]]]) -> None:
    """Draw variant → method → area → figures: a panel per variant, class and figure, the mean last."""
    columns = [(variant, kind) for variant in scores for kind in CLASSES]
    size = (4.1 * len(columns), 2.3 * len(FIGURES) + 0.9)
    figure, axes = plt.subplots(len(FIGURES), len(columns), figsize=size, dpi=80, sharey=True, squeeze=False)
    for column, (variant, kind) in enumerate(columns):
        for row, (member, name) in enumerate(FIGURES.items()):
            _draw_bars(axes[row, column], scores[variant], f"{kind}_{member}", CLASSES[kind][1])
            axes[row, 0].set_ylabel(f"{name} [%]")
        axes[0, column].set_title(f"{CLASSES[kind][0]}, {VARIANTS[variant]}")
    used = [method for method in LOOKS if any(method in by_method for by_method in scores.values())]
    handles = [plt.Rectangle((0, 0), 1, 1, color=LOOKS[m][1], label=LOOKS[m][0]) for m in used]
    handles.append(
        plt.Rectangle((0, 0), 1, 1, color="0.93", label="the paper's range (dashed: mean), other areas")
    )
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False)
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    figure.savefig(path, metadata={"Software": None})
    plt.close(figure)
    # A palette: a third of the size.
    Image.open(path).convert("RGB").quantize(64, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
        path, optimize=True
    )


def _draw_bars(
    axes: plt.Axes,
    scores: Mapping[str, Mapping[str, Figures]],
    member: str,
    paper: tuple[float, float, float],
) -> None:
    """Draw one figure of all methods: a group of bars per area, and one of the means."""
    least, greatest, mean = paper
    axes.axhspan(least, greatest, color="0.93", zorder=0)
    axes.axhline(mean, color="0.6", linewidth=0.8, linestyle="--", zorder=1)
    width = 0.86 / len(scores)
    for k, (method, by_area) in enumerate(scores.items()):
        values = [100 * score[member] for score in by_area.values()]
        places = np.arange(len(values) + 1) + (k - (len(scores) - 1) / 2) * width
        axes.bar(places, [*values, np.nanmean(values)], width, color=LOOKS[method][1], zorder=2)
        names = [*by_area, "mean"]
    axes.set_xticks(range(len(names)), names, fontsize=8)
    axes.set(ylim=(0, 100), axisbelow=True)
    axes.spines[["top", "right"]].set_visible(False)
