"""Outlines of Delft's class 6 against the blocks of the base map, ours and peers' on the same clusters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.tables import table
from bench.outlines.chain import STEPS, Chain, chain_of
from bench.outlines.clouds import RoofCloud, read_roofs
from bench.outlines.peers import run_peer
from lidar_buildings.evaluation.readers.metric_polygons import read_metric_polygons
from lidar_buildings.evaluation.scores.outlines import (
    MIN_IOU,
    score_corners,
    score_directions,
    score_outlines,
)
from lidar_buildings.pipeline.config import PipelineConfig

#: Headings of what `quality_cells` gives.
HEADINGS = (
    "area IoU",
    "unions [m]",
    "found",
    "F1",
    "mean IoU",
    "vertices",
    "of map",
    "corner P",
    "R",
    "angle [°]",
    "valid",
)


class Reference(NamedTuple):
    """The map."""

    #: In the map frame of the cloud; the blocks are complete within the area [m]. Shapely geometries.
    blocks: NDArray[Any]
    area: NDArray[Any]


class Peered(NamedTuple):
    """Every method's outlines and times on one cloud."""

    n_clusters: int  #: clusters that all methods were given
    polygons: dict[str, NDArray[Any]]  #: method → outlines
    seconds: dict[str, float]  #: method → least wall time of the repeats
    steps: dict[str, float]  #: this package's steps → time in its fastest repeat


def read_delft(data: Path) -> tuple[RoofCloud, Reference]:
    """Read both halves as one cloud, and the map."""
    folder = data / "delft"
    cloud = read_roofs("delft", sorted(folder.glob("*.laz")))
    blocks, area = (
        shapely.transform(
            read_metric_polygons(folder / f"{name}_nw.gpkg").polygons, lambda xy: xy - cloud.origin
        )
        for name in ("blocks", "aoi")
    )
    return cloud, Reference(blocks, area)


def run_all(
    cloud: RoofCloud, configs: dict[str, PipelineConfig], peers: Sequence[str], repeats: int
) -> Peered:
    """Run every variant of ours and every peer in turns, after one run of each that does not count."""
    first = next(iter(configs.values()))
    clusters = [cloud.roofs.points[one.rows] for one in chain_of(cloud.roofs, first).buildings]
    polygons: dict[str, NDArray[Any]] = {}
    times: dict[str, list[float]] = {}
    chains: list[Chain] = []
    for name in peers:
        run_peer(name, clusters[:2])
    for _ in range(repeats):
        for name, config in configs.items():
            chain = chain_of(cloud.roofs, config)
            polygons[f"ours, {name}"] = chain.polygons
            times.setdefault(f"ours, {name}", []).append(sum(chain.seconds.values()))
            chains.append(chain)
        for name in peers:
            result = run_peer(name, clusters)
            polygons[name] = result.polygons
            times.setdefault(name, []).append(result.seconds)
    fastest = min(chains, key=lambda chain: sum(chain.seconds.values()))
    seconds = {name: min(measured) for name, measured in times.items()}
    return Peered(len(clusters), polygons, seconds, fastest.seconds)


def quality_cells(polygons: NDArray[Any], reference: Reference) -> list[str]:
    """Score outlines in the order of `HEADINGS`."""
    n_valid = int(np.count_nonzero(shapely.is_valid(polygons) & ~shapely.is_empty(polygons)))
    score = score_outlines(polygons, reference.blocks, area=reference.area)
    corners = score_corners(polygons, reference.blocks, area=reference.area)
    found = np.flatnonzero(score["iou_per_reference"] >= MIN_IOU)
    pairs = shapely.make_valid(polygons[score["partner_per_reference"][found]]), reference.blocks[found]
    angles = score_directions(*pairs, limits=shapely.union_all(reference.area))
    return [
        f"{score['area_iou']:.3f}",
        f"{score['boundary_of_unions_mean']:.2f}",
        f"{score['n_found']}/{score['n_reference']}",
        f"{score['f1']:.2f}",
        f"{score['mean_iou']:.3f}",
        str(score["n_vertices_result"]),
        str(score["n_vertices_reference"]),
        f"{corners['precision']:.2f}",
        f"{corners['recall']:.2f}",
        f"{angles['median_deg']:.2f}",
        f"{n_valid}/{len(polygons)}",
    ]


def delft_tables(peered: Peered, reference: Reference) -> str:
    """Return quality by method, and times in multiples of ours."""
    quality = table(
        ("method", *HEADINGS),
        ([name, *quality_cells(each, reference)] for name, each in peered.polygons.items()),
    )
    ours = min(value for name, value in peered.seconds.items() if name.startswith("ours"))
    times = table(
        ("method", "s", "× ours", "buildings/s"),
        (
            [name, f"{value:.3f}", f"{value / ours:.2f}", f"{peered.n_clusters / value:.0f}"]
            for name, value in peered.seconds.items()
        ),
    )
    total = sum(peered.steps.values())
    shares = ", ".join(f"{step} {100 * peered.steps[step] / total:.0f} %" for step in STEPS)
    return f"{quality}\n\n{times}\n\nOurs: {shares}"
