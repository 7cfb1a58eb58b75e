"""Models of single roofs against wireframes that people drew over the same points."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray

from bench.common.arguments import config_of
from bench.common.tables import table
from bench.generalise.disturbances import disturbances
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.stages.building_model.quality import distance_to_surface
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.evaluation.scores.models import Wireframe, roof_wireframe, score_wireframes
from lidar_buildings.evaluation.scores.outlines import match_corners
from lidar_buildings.pipeline import tile_models, tile_outlines, tile_stages, tile_tracing
from lidar_buildings.pipeline.config import PipelineConfig

#: Below the data folder: clouds and wireframes (.obj) of the same names.
FOLDER = "tallinn"
#: Disturbances after which people would still draw the same roof, see `disturbances`.
KINDS = ("strip", "discs", "half", "quarter", "rotated", "shifted", "noisy")
#: The ground under a roof of which roof points alone are known lies so far below them [m].
HEIGHT = 4.0
#: How near corners have to be [m]; edges are judged, and heights compared, by the last one.
TOLERANCES = (0.5, 1.0)
#: A point is on the model within this [m].
ON_MODEL = 0.1
HEADINGS = (
    "roofs", "F1 0.5 m", "worst tenth", "F1 1 m", "precision", "recall", "corners", "drawn", "ratio",
    "edge F1", "RMSE z [m]", "on model",
)  # fmt: skip


class DrawnRoof(NamedTuple):
    """A roof's points, shape (n_points, 3) [m], and what a person drew over them; both about its middle."""

    name: str
    points: NDArray[np.float64]
    drawn: Wireframe


class Counts(NamedTuple):
    """
    What can be added up over roofs: corners paired at either tolerance, and what there is of each kind.

    The offsets are those in z of pairs at the wider tolerance.
    """

    near: int
    far: int
    corners: int
    corners_drawn: int
    edges_paired: int
    edges: int
    edges_drawn: int
    z_offsets: NDArray[np.float64]
    n_on_model: int
    n_points: int

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall of the corners at the narrower tolerance."""
        return 2 * self.near / max(self.corners + self.corners_drawn, 1)


def drawn_roofs(folder: Path) -> list[DrawnRoof]:
    """Read the clouds of a folder that have a wireframe (.obj with `v` and `l`) beside them."""
    return [_read(file) for file in sorted(folder.glob("*.laz")) if file.with_suffix(".obj").is_file()]


def _read(file: Path) -> DrawnRoof:
    words = [line.split() for line in file.with_suffix(".obj").read_text().splitlines()]
    corners = np.array([word[1:4] for word in words if word[:1] == ["v"]], dtype=float)
    lines = np.array([word[1:3] for word in words if word[:1] == ["l"]], dtype=int) - 1
    edges = np.unique(np.sort(lines, axis=1), axis=0)
    points = np.asarray(laspy.read(file).xyz, dtype=float)
    middle = np.append(np.round(points[:, :2].mean(axis=0)), 0.0)
    frame = Wireframe(corners - middle, edges.astype(np.int64), np.zeros(len(edges), dtype=bool))
    return DrawnRoof(file.stem, points - middle, frame)


def models_of(points: NDArray[np.float64], config: PipelineConfig) -> list[BuildingModel]:
    """Take roof points without ground through the chain, from segmentation on."""
    roofs, outlines = _planes_and_outlines(points, config)
    return [one.model for one in tile_models.build_models(roofs, outlines, config.building_model)]


def traced_roofs(
    points: NDArray[np.float64], config: PipelineConfig
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.uint16], BuildingOutline]]:
    """Yield points, planes and outline of each building that `models_of` makes a model of."""
    roofs, outlines = _planes_and_outlines(points, config)
    for one in outlines:
        own = roofs.building_id == one.building_id
        yield roofs.points[own], roofs.plane_id[own], one


def _planes_and_outlines(
    points: NDArray[np.float64], config: PipelineConfig
) -> tuple[PointTile, tuple[BuildingOutline, ...]]:
    tile = PointTile(
        points,
        classification=np.full(len(points), PointClass.BUILDING, dtype=np.uint8),
        height_above_ground=points[:, 2] - points[:, 2].min() + HEIGHT,
    )
    found = tile_tracing.trace_buildings(tile, config.segmentation, config.boundary_tracing)
    outlines = tile_outlines.regularise_outlines(found.outlines, config.regularisation)
    return tile_stages.fit_planes(found.tile, config.plane_fitting), outlines


def solids_of(points: NDArray[np.float64], config: PipelineConfig) -> list[Solid]:
    """Return the finest solids of `models_of`."""
    models = models_of(points, config)
    return [model.solids[max(model.solids)] for model in models if model.solids]


def counts_of(points: NDArray[np.float64], drawn: Wireframe, solids: list[Solid]) -> Counts:
    """Compare the model made of a roof's points with what was drawn over it."""
    frame = roof_wireframe(solids)
    mine, theirs, _ = match_corners(frame.corners, drawn.corners, TOLERANCES[-1])
    edges = score_wireframes(frame, drawn, TOLERANCES[-1])
    away = np.full(len(points), np.inf)
    for solid in solids:
        away = np.minimum(away, distance_to_surface(points, solid, np.full(len(points), np.inf)))
    return Counts(
        near=len(match_corners(frame.corners, drawn.corners, TOLERANCES[0])[0]),
        far=len(mine),
        corners=len(frame.corners),
        corners_drawn=len(drawn.corners),
        edges_paired=edges["n_edges_matched"],
        edges=len(frame.edges),
        edges_drawn=len(drawn.edges),
        z_offsets=frame.corners[mine, 2] - drawn.corners[theirs, 2],
        n_on_model=int(np.count_nonzero(away <= ON_MODEL)),
        n_points=len(points),
    )


def report(data: Path, options: argparse.Namespace) -> str:
    """Model every roof as it is and disturbed, and compare: a line per kind, all roofs' corners together."""
    chosen = config_of(options.set)
    found: dict[str, list[Counts]] = {}
    for number, roof in enumerate(drawn_roofs(data / FOLDER)):
        found.setdefault("plain", []).append(
            counts_of(roof.points, roof.drawn, solids_of(roof.points, chosen))
        )
        for one in disturbances(roof.points, kinds=KINDS, quick=options.quick, seed=options.seed + number):
            drawn = replace(roof.drawn, corners=one.moved(roof.drawn.corners))
            counts = counts_of(one.points, drawn, solids_of(one.points, chosen))
            found.setdefault(one.kind, []).append(counts)
    disturbed = [one for kind in KINDS for one in found.get(kind, [])]
    return corner_table(found | {"all disturbed": disturbed})


def corner_table(counts: Mapping[str, list[Counts]]) -> str:
    """Return a line for each list of counts, all roofs' corners together."""
    return table(("disturbance", *HEADINGS), ([name, *cells_of(group)] for name, group in counts.items()))


def cells_of(group: list[Counts]) -> list[str]:
    """Return the figures of roofs together in the order of `HEADINGS`."""

    def total(name: str) -> int:
        return sum(getattr(one, name) for one in group)

    mine, drawn, edges = total("corners"), total("corners_drawn"), total("edges") + total("edges_drawn")
    worst = np.sort([one.f1 for one in group])[: max(1, round(0.1 * len(group)))].mean()
    offsets = np.concatenate([one.z_offsets for one in group])
    return [
        str(len(group)),
        f"{2 * total('near') / (mine + drawn):.3f}",
        f"{worst:.3f}",
        f"{2 * total('far') / (mine + drawn):.3f}",
        f"{total('near') / max(mine, 1):.3f}",
        f"{total('near') / drawn:.3f}",
        str(mine),
        str(drawn),
        f"{mine / drawn:.2f}",
        f"{2 * total('edges_paired') / edges:.3f}",
        f"{float(np.sqrt(np.mean(offsets**2))) if len(offsets) else np.nan:.3f}",
        f"{total('n_on_model') / total('n_points'):.4f}",
    ]
