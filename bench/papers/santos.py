"""Santos, Galo and others: Table 1, Figures 2 to 4, 7 and 8, close neighbours, walls seen from the street."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.common.areas import RoofArea, areas_in, split
from bench.common.tables import percent
from bench.edges.run import METHODS, edges_of, label_area
from bench.papers import cube
from bench.papers.close_neighbours import close_neighbours
from bench.papers.pages import Section, markdown, spread
from bench.papers.presets import config_of
from bench.papers.street_walls import street_walls
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.evaluation.scores.cells import Figures
from lidar_buildings.evaluation.scores.edges import (
    PAPER_ALPHA,
    PAPER_DENSITY,
    reference_edges,
    roofs_of_polygons,
    score_edges,
)
from lidar_buildings.simulation import simulate_tile

#: Virtual areas: curved and plain roofs apart (the paper's area 1), a village (2), all types of roof,
#: courtyards.
SCENES = ("special_roofs", "village", "roof_types", "courtyards")
#: Method → name in the tables.
NAMES = {
    "k_means_eigenvalues": "λ1, λ2, λ3",
    "k_means_linearity_planarity": "L, P",
    "k_means_linearity": "L",
    "discriminant_analysis": "discriminant analysis",
}
PAPER_ROW = ["paper", "all", "–", "–", "61 to 98, mean about 79", "mean about 97"]
Scores = dict[str, dict[str, dict[str, Figures]]]


def sections(data: Path, folder: Path | None) -> Iterator[Section]:
    """Measure one table after the other; draw the figures into a folder if one is given."""
    yield Section("table-1", cube.table_1())
    areas = {name: virtual_area(name) for name in SCENES}
    real = areas_in(data)
    thinned = {f"{name}, thinned": split(thinned_area(area)) for name, area in real.items()}
    found = scores_of(areas), scores_of(thinned)
    yield Section("figure-7", _figure_7(*found))
    yield Section("ranking", _ranking(*found))
    yield Section("own-densities", _own_densities(real))
    yield Section("close-neighbours", close_neighbours(NAMES, folder))
    yield Section("street-walls", street_walls(NAMES, folder))
    if folder is not None:
        from bench.edges.plot import draw_scores

        cube.draw(folder)
        for name, scores in zip(("virtual", "real"), found, strict=True):
            draw_scores(folder / f"santos_figure_7_{name}.png", scores)
        _draw_edges(folder, areas | thinned)


def variants() -> dict[str, EdgeLabellingConfig]:
    """Return what the methods are run with beside their own parameters."""
    return {"published": config_of("santos").edge_labelling, "default": EdgeLabellingConfig()}


def virtual_area(scene: str) -> RoofArea:
    """Scan a scene at the paper's density; each building is one roof, as if cut out by hand."""
    tile, truth = simulate_tile(scene, density=PAPER_DENSITY)
    points = np.round(tile.points[truth.plane > 0], 3)
    roof = roofs_of_polygons(points, [building.polygon for building in truth.scene.buildings])
    return RoofArea(points[roof >= 0], roof[roof >= 0], measure_spacing(points), 0)


def thinned_area(area: RoofArea) -> RoofArea:
    """Keep as many points, by chance, as the paper's cloud has; all of a sparser one."""
    share = PAPER_DENSITY * area.spacing**2
    kept = np.random.default_rng(0).random(len(area.points)) < share
    points = area.points[kept]
    return RoofArea(points, area.roof[kept], measure_spacing(points), 0)


def scores_of(areas: Mapping[str, RoofArea]) -> Scores:
    """Score every method against alpha shapes of the paper's radius: variant → method → area → figures."""
    truth = {name: reference_edges(area.points, area.roof, PAPER_ALPHA) for name, area in areas.items()}
    return {
        variant: {
            method: {
                name: score_edges(label_area(area, method, replace(base, **setting)), truth[name])
                for name, area in areas.items()
            }
            for method, setting in METHODS.items()
        }
        for variant, base in variants().items()
    }


def _figure_7(virtual: Scores, real: Scores) -> str:
    rows = [PAPER_ROW]
    for title, scores in (("virtual", virtual), ("real, thinned", real)):
        rows += [
            [f"{NAMES[method]}, {variant}", title, *_cells(list(by_area.values()))]
            for variant, by_method in scores.items()
            for method, by_area in by_method.items()
        ]
    headings = ("method", "areas", "edge completeness", "edge correctness", "edge F", "non-edge F")
    by_area = [
        [
            f"{NAMES[method]}, {variant}",
            *(percent(s[method][a]["edge_f_score"])[:-1] for s, a in _areas(virtual, real, variant)),
        ]
        for variant in virtual
        for method in virtual[variant]
    ]
    names = [area for _, area in _areas(virtual, real, "published")]
    return (
        f"{markdown(headings, rows)}\n\nMean / median / root mean square over the areas [%]. "
        "Edge F by area:\n\n"
        f"{markdown(('method', *names), by_area)}"
    )


def _areas(virtual: Scores, real: Scores, variant: str) -> list[tuple[dict[str, dict[str, Figures]], str]]:
    return [
        (scores[variant], area) for scores in (virtual, real) for area in next(iter(scores[variant].values()))
    ]


def _cells(scores: list[Figures]) -> list[str]:
    members = ("edge_completeness", "edge_correctness", "edge_f_score", "non_edge_f_score")
    return [spread([100 * score[member] for score in scores], 0) for member in members]


def _ranking(virtual: Scores, real: Scores) -> str:
    """Order the methods by their mean, best first."""
    rows = [["paper", "λ", "L, P and L", "L, P and L alike; λ and discriminant analysis take turns"]]
    for title, scores in (("virtual", virtual), ("real, thinned", real)):
        for variant, by_method in scores.items():
            cells = []
            for member in ("edge_completeness", "edge_correctness", "edge_f_score"):
                means = {
                    NAMES[method]: float(np.mean([one[member] for one in by_area.values()]))
                    for method, by_area in by_method.items()
                }
                order = sorted(means, key=lambda name: -means[name])
                cells.append(" > ".join(f"{name} {100 * means[name]:.1f}" for name in order))
            rows.append([f"{title}, {variant}", *cells])
    return markdown(("areas", "edge completeness [%]", "edge correctness [%]", "edge F [%]"), rows)


def _own_densities(areas: Mapping[str, RoofArea]) -> str:
    """Return the same at each cloud's own density, blocks one roof, the disc in proportion to the spacing."""
    rows = []
    truth = {name: edges_of(area) for name, area in areas.items()}
    for variant, base in variants().items():
        for method, setting in METHODS.items():
            config = replace(base, **setting)
            found = [
                score_edges(label_area(area, method, config), truth[name]) for name, area in areas.items()
            ]
            by_area = [percent(one["edge_f_score"])[:-1] for one in found]
            rows.append([f"{NAMES[method]}, {variant}", *_cells(found), *by_area])
    headings = ("method", "edge completeness", "edge correctness", "edge F", "non-edge F")
    return markdown((*headings, *(f"F, {name}" for name in areas)), rows)


def _draw_edges(folder: Path, areas: Mapping[str, RoofArea]) -> None:
    """Draw Figure 8, the edges by linearity, beside the reference (Figure 4)."""
    from bench.common.plotting import plt

    for name, area in areas.items():
        config = replace(variants()["published"], **METHODS["k_means_linearity"])
        labels: dict[str, NDArray[np.bool_]] = {
            "classified by L (Figure 8)": label_area(area, "k_means_linearity", config),
            "reference, alpha 0.60 m (Figure 4)": reference_edges(area.points, area.roof, PAPER_ALPHA),
        }
        figure, axes = plt.subplots(1, 2, figsize=(20, 10))
        for panel, (title, edge) in zip(axes, labels.items(), strict=True):
            panel.scatter(*area.points[:, :2].T, s=1, c=np.where(edge, "tab:blue", "lightgrey"))
            panel.set(aspect="equal", title=f"{name}: {title}")
        slug = name.replace(", ", "_").replace(" ", "_")
        figure.savefig(folder / f"santos_figures_4_and_8_{slug}.png", dpi=70, bbox_inches="tight")
        plt.close(figure)
