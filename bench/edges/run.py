"""
Edge labels against the alpha shapes of roofs, by the protocol of Santos, Galo and others: their Figure 7.

    python -m bench.edges.run [--data DIR] [--methods METHOD ...] [--set NAME=VALUE ...]
                          [--variants VARIANT ...] [--split-steps] [--plot FILE]

Four areas: Delft (AHN3, class 6 within the blocks of a map), Montpellier and fusa (class 6, parts that hang
together in plan) and Toronto (unclassified: what this package takes for roofs). All roof points of an area
are labelled in one go; a point that lies on the 2D alpha shape of its roof is an edge point in the reference.

Each method is run as published, and with the defaults, which thin the band of edge points to rims of roofs.
A rim is found by an empty disc, and so is the reference: a control shows what that disc finds by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.common.areas import RoofArea, areas_in, split
from bench.common.arguments import parser_of, settings_of
from bench.common.clouds import data_folder
from bench.common.tables import percent, table
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.stages.edge_labelling.config import AS_PUBLISHED, EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.labelling import label_edges
from lidar_buildings.evaluation.scores.cells import Figures
from lidar_buildings.evaluation.scores.edges import alpha_of_spacing, reference_edges, score_edges

#: The methods of the paper's Figure 7, and the parameters that choose them.
METHODS: dict[str, dict[str, str]] = {
    "k_means_eigenvalues": {"method": "k_means", "features": "eigenvalues"},
    "k_means_linearity_planarity": {"method": "k_means", "features": "linearity_planarity"},
    "k_means_linearity": {"method": "k_means", "features": "linearity"},
    "discriminant_analysis": {"method": "discriminant_analysis"},
}
#: Without features: all points that the empty disc of the thinning finds.
CONTROL = "rims_alone"
#: What the methods are run with beside their own parameters.
VARIANTS = {"published": AS_PUBLISHED, "default": EdgeLabellingConfig()}
#: Figures in the order of the table, with their headings.
FIGURES = {
    "edge_completeness": "edge compl.",
    "edge_correctness": "corr.",
    "edge_f_score": "F",
    "non_edge_completeness": "other compl.",
    "non_edge_correctness": "corr.",
    "non_edge_f_score": "F",
}
#: What the paper's text says of its Figure 7 (the bars themselves have no numbers).
PUBLISHED = (
    "Santos, Galo and others, on four other areas: edges 61 to 98 %, mean about 79 %; non-edges above 92 %,\n"
    "mean about 97 %; least edge correctness about 70 % (area 2); F of (L, P) and (L) alike, and best."
)


def edges_of(area: RoofArea) -> NDArray[np.bool_]:
    """Return the points on the alpha shapes of an area's roofs, the paper's radius."""
    return reference_edges(area.points, area.roof, alpha_of_spacing(area.spacing))


def configs_of(
    variant: str, methods: Sequence[str], settings: Mapping[str, Any]
) -> dict[str, EdgeLabellingConfig]:
    """Return each method's parameters; the control has them too, where points are thinned."""
    base = replace(VARIANTS[variant], **settings)
    configs = {method: replace(base, **METHODS[method]) for method in methods}
    return configs if base.thinning == "none" else {**configs, CONTROL: base}


def label_area(area: RoofArea, method: str, config: EdgeLabellingConfig) -> NDArray[np.bool_]:
    """Label all roof points of an area in one go."""
    if method == CONTROL:
        radius = config.rim_radius * quantised_spacing(area.points)
        return reference_edges(area.points, np.zeros(len(area.points), dtype=np.int64), radius)
    return label_edges(area.points, config).edge == 1


def scores_of(
    areas: Mapping[str, RoofArea],
    configs: Mapping[str, EdgeLabellingConfig],
) -> dict[str, dict[str, Figures]]:
    """Score each method in each area: method → area → figures."""
    scores: dict[str, dict[str, Figures]] = {method: {} for method in configs}
    for name, area in areas.items():
        truth = edges_of(area)
        for method, config in configs.items():
            scores[method][name] = score_edges(label_area(area, method, config), truth)
    return scores


def means_of(scores: Mapping[str, Figures]) -> dict[str, float]:
    """Return the means over areas, each weighing the same; those where there is nothing to share left out."""
    found = {name: np.array([score[name] for score in scores.values()]) for name in FIGURES}
    return {name: float(np.nanmean(v)) if np.isfinite(v).any() else np.nan for name, v in found.items()}


def rows_of(scores: Mapping[str, Mapping[str, Figures]]) -> list[list[str]]:
    """Lines of the table: each method's areas, and their mean."""
    rows = []
    for method, by_area in scores.items():
        for area, score in by_area.items():
            rows.append([method, area, *(percent(score[name]) for name in FIGURES)])
        rows.append([method, "mean", *(percent(mean) for mean in means_of(by_area).values())])
    return rows


def area_rows(areas: Mapping[str, RoofArea]) -> list[list[str]]:
    """Lines that say what the areas are: roofs, points, spacing, radius of the disc, share of edges."""
    rows = []
    for name, area in areas.items():
        counts = (len(np.unique(area.roof)), len(area.points), area.n_left_out)
        lengths = f"{area.spacing:.3f}", f"{alpha_of_spacing(area.spacing):.3f}"
        rows.append([name, *map(str, counts), *lengths, percent(edges_of(area).mean())])
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = parser_of(__doc__, tuple(METHODS))
    parser.add_argument("--variants", nargs="+", choices=tuple(VARIANTS), default=tuple(VARIANTS))
    parser.add_argument(
        "--split-steps", action="store_true", help="take for one roof what has no step in height within"
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the figures as bars")
    options = parser.parse_args(arguments)
    settings = settings_of(options.set, "edge_labelling")
    chosen = {field.name for field in fields(EdgeLabellingConfig)} & {"method", "features"} & settings.keys()
    if chosen:
        raise SystemExit(f"--set {chosen.pop()}: is what --methods chooses")
    areas = areas_in(data_folder(options.data))
    if options.split_steps:
        areas = {name: split(area) for name, area in areas.items()}
    headings = ("area", "roofs", "points", "left out", "spacing m", "alpha m", "edges %")
    print(table(headings, area_rows(areas)))
    scores = {}
    for variant in options.variants:
        configs = configs_of(variant, options.methods, settings)
        scores[variant] = scores_of(areas, configs)
        print(f"\n{variant.capitalize()}:")
        print(table(("method", "area", *FIGURES.values()), rows_of(scores[variant])))
    print(f"\n{PUBLISHED}")
    if options.plot is not None:
        from bench.edges.plot import draw_scores

        draw_scores(options.plot, scores)


if __name__ == "__main__":
    main()
