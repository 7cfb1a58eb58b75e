"""
Edge labels against the alpha shapes of roofs, by the protocol of Santos, Galo and others: their Figure 7.

    python bench/edges.py [--data DIR] [--methods METHOD ...] [--set NAME=VALUE ...]
                          [--alpha-factor SPACINGS] [--regularised] [--plot FILE] [--pictures DIR]

Four areas: Delft (AHN3, class 6 within the blocks of a map), Montpellier and fusa (class 6, parts that hang
together in plan) and Toronto (unclassified: what this package takes for roofs). All roof points of an area
are labelled in one go; a point that lies on the 2D alpha shape of its roof is an edge point in the reference.

"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from agreement import percent, table
from arguments import add_pictures, picture_folder, settings_of
from clouds import data_folder
from numpy.typing import NDArray
from roof_areas import RoofArea, areas_in, split

from lidar_buildings.core.edge_labelling import EdgeLabellingConfig, label_edges
from lidar_buildings.core.scores.edges import EdgeScore, alpha_of_spacing, reference_edges, score_edges

#: The methods of the paper's Figure 7, and the parameters that choose them.
METHODS: dict[str, dict[str, str]] = {
    "k_means_eigenvalues": {"method": "k_means", "features": "eigenvalues"},
    "k_means_linearity_planarity": {"method": "k_means", "features": "linearity_planarity"},
    "k_means_linearity": {"method": "k_means", "features": "linearity"},
    "discriminant_analysis": {"method": "discriminant_analysis"},
}
#: Members of EdgeScore in the order of the table, with their headings.
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
    "Santos, Galo and others, four other areas: edges 61 to 98 %, mean about 79 %; non-edges above 92 %, "
    "mean about 97 %;\nlowest edge correctness about 70 % (their area 2); F of (L, P) and (L) alike and best."
)


def available(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """
    Return the methods with the parameters that the stage has; those that need others are left out.

    """
    known = {field.name for field in fields(EdgeLabellingConfig)}
    chosen = {name: METHODS[name] for name in names}
    if "method" not in known:
        chosen = {name: s for name, s in chosen.items() if s["method"] == "k_means"}
    return {name: {k: v for k, v in s.items() if k in known} for name, s in chosen.items()}


def label_area(area: RoofArea, settings: Mapping[str, Any]) -> NDArray[np.bool_]:
    """
    Label all roof points of an area in one go.

    """
    return label_edges(area.points, EdgeLabellingConfig(**settings)).edge == 1


def reference_of(area: RoofArea, alpha_factor: float | None, regularised: bool) -> NDArray[np.bool_]:
    """
    Return the points on the alpha shapes of their roofs; the factor is alpha in point spacings.

    """
    alpha = alpha_of_spacing(area.spacing) if alpha_factor is None else alpha_factor * area.spacing
    return reference_edges(area.points, area.roof, alpha, regularised=regularised)


def scores_of(
    areas: Mapping[str, RoofArea],
    methods: Mapping[str, Mapping[str, Any]],
    alpha_factor: float | None = None,
    regularised: bool = False,
    pictures: Path | None = None,
) -> dict[str, dict[str, EdgeScore]]:
    """
    Score each method in each area: method → area → figures.

    """
    scores: dict[str, dict[str, EdgeScore]] = {method: {} for method in methods}
    for name, area in areas.items():
        truth = reference_of(area, alpha_factor, regularised)
        for method, settings in methods.items():
            edge = label_area(area, settings)
            scores[method][name] = score_edges(edge, truth)
            if pictures is not None:
                from pictures import draw_edges

                title = f"{name}, {method}: edge F {percent(scores[method][name].edge_f_score)} %"
                draw_edges(pictures / f"{name}_{method}.png", area.points, edge, truth, title)
    return scores


def means_of(scores: Mapping[str, EdgeScore]) -> dict[str, float]:
    """
    Return the means over areas, each weighing the same.

    """
    return {member: float(np.mean([asdict(s)[member] for s in scores.values()])) for member in FIGURES}


def rows_of(scores: Mapping[str, Mapping[str, EdgeScore]]) -> list[list[str]]:
    """
    Lines of the table: each method's areas, and their mean.

    """
    rows = []
    for method, by_area in scores.items():
        for area, score in by_area.items():
            rows.append([method, area, *(percent(asdict(score)[member]) for member in FIGURES)])
        rows.append([method, "mean", *(percent(mean) for mean in means_of(by_area).values())])
    return rows


def area_rows(
    areas: Mapping[str, RoofArea], alpha_factor: float | None, regularised: bool
) -> list[list[str]]:
    """
    Lines that say what the areas are: roofs, points, spacing, radius of the disc, share of edges.

    """
    rows = []
    for name, area in areas.items():
        alpha = alpha_of_spacing(area.spacing) if alpha_factor is None else alpha_factor * area.spacing
        share = reference_of(area, alpha_factor, regularised).mean()
        counts = (len(np.unique(area.roof)), len(area.points), area.n_left_out)
        rows.append([name, *map(str, counts), f"{area.spacing:.3f}", f"{alpha:.3f}", percent(share)])
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """
    Print the tables.

    """
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", help="folder of the real clouds (default: LIDAR_BUILDINGS_DATA)")
    parser.add_argument("--methods", "--method", nargs="+", choices=tuple(METHODS), default=tuple(METHODS))
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="NAME=VALUE", help="parameters of the edge labelling"
    )
    parser.add_argument(
        "--alpha-factor", type=float, metavar="SPACINGS", help="the disc's radius (default: 1.342 spacings)"
    )
    parser.add_argument(
        "--regularised", action="store_true", help="leave out points of the alpha shape that bound no area"
    )
    parser.add_argument(
        "--split-steps", action="store_true", help="take for one roof what has no step in height within"
    )
    add_pictures(parser)
    options = parser.parse_args(arguments)
    areas = areas_in(data_folder(options.data))
    if options.split_steps:
        areas = {name: split(area) for name, area in areas.items()}
    given = settings_of(options.set, EdgeLabellingConfig)
    methods = {name: {**given, **chosen} for name, chosen in available(options.methods).items()}
    variant = (options.alpha_factor, options.regularised)
    headings = ("area", "roofs", "points", "left out", "spacing m", "alpha m", "edges %")
    print(table(headings, area_rows(areas, *variant)))
    scores = scores_of(areas, methods, *variant, picture_folder(options.pictures))
    print("\n" + table(("method", "area", *FIGURES.values()), rows_of(scores)))
    print("\n" + PUBLISHED)


if __name__ == "__main__":
    main()
