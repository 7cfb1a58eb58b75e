"""Two roofs a narrow gap apart, whether they are told apart, and the edges along it (Santos, outlook)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.areas import RoofArea
from bench.edges.run import METHODS, label_area
from bench.outlines.chain import chain_of
from bench.papers.pages import markdown
from bench.papers.presets import config_of
from bench.scenes.outlines import Scan
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.evaluation.scores.cells import ratio
from lidar_buildings.evaluation.scores.edges import PAPER_DENSITY, alpha_of_spacing, reference_edges
from lidar_buildings.pipeline.config import PipelineConfig

#: Widths of the gap, and how much higher the second roof lies [m].
GAPS, STEPS = (0.3, 0.5, 0.75, 1.0, 1.5, 2.0), (0.0, 1.0, 3.0)
#: Points per square metre: the paper's, and a dense survey's.
DENSITIES = (PAPER_DENSITY, 20.0)
#: Orientations, each with a pattern drawn anew [deg].
ROTATIONS = (0.0, 10.0, 25.0, 45.0, 70.0, 80.0)
#: The roofs: 15 × 10 m, their long sides along the gap; their elevation, and noise [m].
LENGTH, WIDTH, ROOF, NOISE = 15.0, 10.0, 8.0, 0.03
#: Methods that are looked at: linearity alone is as linearity and planarity.
LABELLED = ("k_means_eigenvalues", "k_means_linearity_planarity", "discriminant_analysis")
#: Points so near to the gap's walls are asked [spacings].
NEAR = 2.0


class Pair(NamedTuple):
    """Two roofs."""

    area: RoofArea
    in_gap: NDArray[np.bool_]  #: points near the walls along the gap, shape (n_points,)


def pair(gap: float, step: float, density: float, rotation_deg: float, seed: int) -> Pair:
    """Scan two roofs."""
    random = np.random.default_rng([seed, round(100 * gap), round(10 * step), round(rotation_deg)])
    turn = np.deg2rad(rotation_deg)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    boxes = [shapely.box(0.0, y, LENGTH, y + WIDTH) for y in (0.0, WIDTH + gap)]
    roofs = [shapely.transform(one, lambda xy: xy @ axes) for one in boxes]
    xy = Scan.drawn(random).over(shapely.MultiPolygon(roofs), density, random)
    roof = shapely.intersects_xy(roofs[1], *xy.T).astype(np.int64)
    points = np.column_stack((xy, ROOF + step * roof)) + random.normal(0.0, NOISE, (len(xy), 3))
    y = xy @ axes.T[:, 1]
    spacing = density**-0.5
    beside = np.where(roof == 0, WIDTH - y, y - WIDTH - gap)
    return Pair(RoofArea(points, roof, spacing, 0), np.abs(beside) <= NEAR * spacing)


def segmentations() -> dict[str, PipelineConfig]:
    """Return the ways to part buildings."""
    return {
        "default": PipelineConfig(),
        "default, `split_at_steps`": PipelineConfig(segmentation=SegmentationConfig(split_at_steps=True)),
        "sampath_shan": config_of("sampath_shan"),
    }


def labellings() -> dict[str, tuple[str, EdgeLabellingConfig]]:
    """Return the ways to label edges: name → method of the bench, parameters."""
    published, default = config_of("santos").edge_labelling, EdgeLabellingConfig()
    ways = {f"{method}, published": (method, replace(published, **METHODS[method])) for method in LABELLED}
    both = LABELLED[1]
    return ways | {
        f"{both}, default": (both, default),
        f"{both}, `thinning` surface": (both, replace(default, thinning="surface")),
    }


def gap_f_score(one: Pair, method: str, config: EdgeLabellingConfig) -> float:
    """Return F of the edges near the gap against the alpha shapes of either roof alone."""
    area = one.area
    truth = reference_edges(area.points, area.roof, alpha_of_spacing(area.spacing))[one.in_gap]
    edge = label_area(area, method, config)[one.in_gap]
    hits = int((truth & edge).sum())
    return ratio(2 * hits, int(truth.sum()) + int(edge.sum()))


def close_neighbours(names: Mapping[str, str], folder: Path | None) -> str:
    """Return both tables: how often there are two buildings, and F of the edges in the gap."""
    found: dict[str, list[list[str]]] = {"two": [], "edges": []}
    for density in DENSITIES:
        for step in STEPS:
            scenes = {
                gap: [pair(gap, step, density, turn, seed) for seed, turn in enumerate(ROTATIONS)]
                for gap in GAPS
            }
            where = [f"{density:g}", f"{step:g}"]
            for name, config in segmentations().items():
                two = [sum(_n_buildings(one, config) == 2 for one in scenes[gap]) for gap in GAPS]
                found["two"].append([name, *where, *(f"{n} of {len(ROTATIONS)}" for n in two)])
            for name, way in labellings().items():
                method, _, variant = name.partition(", ")
                scores = [np.mean([gap_f_score(one, *way) for one in scenes[gap]]) for gap in GAPS]
                cells = [f"{100 * score:.0f}" for score in scores]
                found["edges"].append([f"{names[method]}, {variant}", *where, *cells])
    if folder is not None:
        _draw(folder / "santos_close_neighbours.png")
    headings = ("points/m²", "step [m]", *(f"gap {gap:g} m" for gap in GAPS))
    return (
        f"Two buildings found, of two:\n\n{markdown(('segmentation', *headings), found['two'])}\n\n"
        f"Edge F near the gap [%]:\n\n{markdown(('edges', *headings), found['edges'])}"
    )


def _n_buildings(one: Pair, config: PipelineConfig) -> int:
    tile = PointTile(points=one.area.points).with_columns(point_spacing=one.area.spacing)
    return len(chain_of(tile, config).buildings)


def _draw(path: Path) -> None:
    """Draw edges and outlines of some pairs at the paper's density."""
    from bench.common.plotting import plt

    figure, axes = plt.subplots(2, 3, figsize=(18, 16))
    method, config = labellings()["k_means_linearity_planarity, published"]
    for row, step in zip(axes, (0.0, 3.0), strict=True):
        for panel, gap in zip(row, (0.3, 1.0, 2.0), strict=True):
            one = pair(gap, step, PAPER_DENSITY, ROTATIONS[1], 1)
            edge = label_area(one.area, method, config)
            panel.scatter(*one.area.points[:, :2].T, s=6, c=np.where(edge, "tab:blue", "lightgrey"))
            tile = PointTile(points=one.area.points).with_columns(point_spacing=one.area.spacing)
            for building in chain_of(tile, PipelineConfig()).buildings:
                ring = building.outline.exterior
                panel.plot(*np.vstack((ring, ring[:1])).T, color="tab:red")
            panel.set(aspect="equal", title=f"gap {gap:g} m, step {step:g} m")
    figure.savefig(path, dpi=60, bbox_inches="tight")
    plt.close(figure)
