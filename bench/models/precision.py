"""
How often a model's corners are as near to the truth as they say.

    python -m bench.models.precision [--seeds N ...] [--set STAGE.NAME=VALUE ...] [--each] [--conditions]

Virtual roofs, each with a density, a noise and an orientation of its own, are traced and modelled as they are
and under the disturbances of `bench.generalise`. Corners of LoD2.2 are matched one to one with those of the
truth within 1 m; what is farther off is another topology. Left out are round roofs, which have no corners,
and true corners with another one within 1 m in plan, which may be taken for one another. Shares of errors
within one and two standard deviations should be near 68 and 95 %. By default `regularisation.correct_bias` is
set: walls drawn through the points are inside the roof's edge by a third of a spacing, which is no chance.

With `--conditions`: what holds of the planes of virtual roofs and of those that people drew, what their
points refuse, and how far true corners are off the nearest plane along z without and with it.
"""

from __future__ import annotations

import argparse
import logging
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.arguments import config_of
from bench.common.clouds import data_folder
from bench.common.tables import table
from bench.generalise.corners import FOLDER, drawn_roofs, models_of, traced_roofs
from bench.generalise.disturbances import disturbances
from bench.models.grade_cases import virtual_scene
from bench.scenes.models import SHAPES
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.solids.roof_lines import CORNER_KINDS, corner_kinds, roof_lines
from lidar_buildings.core.solids.shell import ROOF_SURFACE
from lidar_buildings.core.stages.building_model.model import LOD22
from lidar_buildings.core.stages.building_model.precision import Sampling, outline_variances
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.core.stages.roof_topology.result import RoofTopology
from lidar_buildings.core.stages.roof_topology.topology import find_topology
from lidar_buildings.core.surfaces.plane_adjustment import (
    ALIKE,
    CORNER,
    EAVES,
    LEVEL,
    POINT,
    SLOPE,
    STRIKE,
    adjust,
)
from lidar_buildings.core.surfaces.roof_planes import without_gaps
from lidar_buildings.evaluation.scores.models import roof_wireframe
from lidar_buildings.evaluation.scores.outlines import match_corners
from lidar_buildings.pipeline.config import PipelineConfig

#: Those after which the roof is still the same.
KINDS = ("strip", "discs", "half", "quarter", "rotated", "shifted", "noisy", "lines", "stretched")
ROUND = ("barrel", "round_tower", "pointed_tower")
CONDITION_KINDS = (LEVEL, POINT, CORNER, SLOPE, STRIKE, EAVES, ALIKE)
#: Matched corners, and those that may be taken for one another, are nearer [m]; the same one is, in plan [m].
NEAR, SAME = 1.0, 0.02


class Matched(NamedTuple):
    """A corner of a model beside the true one."""

    kind: str
    error: NDArray[np.float64]  #: along x, y and z [m]
    sigma: NDArray[np.float64]  #: as the model says [m]


class Corner(NamedTuple):
    """The same, with the roof that it is of."""

    shape: str
    disturbance: str
    kind: str
    error: NDArray[np.float64]  #: along x, y and z [m]
    sigma: NDArray[np.float64]  #: as the model says [m]


def told_corners(model: BuildingModel) -> Iterator[tuple[str, NDArray[np.float64], list[float]]]:
    """Yield kind, place and standard deviations of the corners of LoD2.2 at which edges end or turn."""
    solid = model.solids.get(LOD22)
    if solid is None:
        return
    kinds = corner_kinds(solid, roof_lines(solid))
    real = set(map(tuple, np.rint(roof_wireframe([solid]).corners * 1000.0).tolist()))
    sigmas: dict[int, list[float]] = {}
    for face, kind, told in zip(solid.faces, solid.semantics, model.of_faces[LOD22], strict=True):
        if kind == ROOF_SURFACE:
            for ring, own in zip(face, told["corner_sigmas"], strict=True):
                sigmas.update(zip(ring, own, strict=True))
    for row, sigma in sigmas.items():
        if row in kinds and tuple(np.rint(solid.vertices[row] * 1000.0).tolist()) in real:
            yield kinds[row], solid.vertices[row], sigma


def matched_corners(models: Iterable[BuildingModel], true: NDArray[np.float64]) -> list[Matched]:
    """Match the corners of models with true ones, shape (n, 3) [m], that no other may be taken for."""
    told = [corner for model in models for corner in told_corners(model)]
    if not told:
        return []
    away = np.linalg.norm(true[:, None, :2] - true[:, :2], axis=2)
    is_alone = ~((away > SAME) & (away < NEAR)).any(axis=1)
    rows, columns, _ = match_corners(np.array([place for _, place, _ in told]), true, NEAR)
    return [
        Matched(told[i][0], told[i][1] - true[j], np.array(told[i][2]))
        for i, j in zip(rows[is_alone[columns]], columns[is_alone[columns]], strict=True)
    ]


def corners_of(seed: int, config: PipelineConfig) -> Iterator[Corner]:
    """Yield the matched corners of all shapes, as they are and disturbed."""
    for name in sorted(SHAPES.keys() - set(ROUND)):
        scene = virtual_scene(name, seed)
        truth = scene.wireframe.corners
        cases = [("plain", scene.points, truth)]
        chance = seed + zlib.crc32(name.encode())
        for one in disturbances(scene.points, kinds=KINDS, quick=True, seed=chance):
            cases.append((one.kind, one.points, one.moved(truth)))
        for kind, points, true in cases:
            for corner in matched_corners(models_of(points, config), true):
                yield Corner(name, kind, *corner)


def share_table(corners: Sequence[Corner], groups: Sequence[str], name: str) -> str:
    """Return a line per group: share of errors within one and two σ, and medians, along each axis."""
    rows = []
    for group in groups:
        own = [one for one in corners if getattr(one, name) == group]
        if not own:
            continue
        error, sigma = np.abs([one.error for one in own]), np.array([one.sigma for one in own])
        cells = [group, str(len(own))]
        for axis in range(3):
            within = [np.mean(error[:, axis] <= k * sigma[:, axis]) for k in (1, 2)]
            cells += [f"{100 * share:.0f}" for share in within]
            cells += [f"{np.median(error[:, axis]):.3f}", f"{np.median(sigma[:, axis]):.3f}"]
        rows.append(cells)
    columns = [f"{axis}: {what}" for axis in "xyz" for what in ("1σ %", "2σ %", "error", "σ")]
    return table((name, "n", *columns), rows)


class Adjusted(NamedTuple):
    """A roof's planes, and how far corners are off the nearest without and with conditions, (n, 2) [m]."""

    name: str
    topology: RoofTopology
    off: NDArray[np.float64]


def adjusted_roofs(name: str, points: NDArray[np.float64], true: NDArray[np.float64]) -> Iterator[Adjusted]:
    """Yield the buildings traced from a roof's points, which have true corners, shape (n, 3) [m]."""
    for part, plane_id, traced in traced_roofs(points, PipelineConfig()):
        part, plane_id = part[rows := np.argsort(part[:, 1])], plane_id[rows]
        outline, spacing = traced.outline, quantised_spacing(part)
        bias = traced.quality.bias if traced.quality else 0.0
        variances = outline_variances(outline, Sampling(part, spacing, bias), None)
        topology = find_topology(part, plane_id, outline, point_spacing=spacing, wall_variances=variances)
        free = adjust(part, without_gaps(plane_id)).planes
        near = true[shapely.dwithin(outline.polygon, shapely.points(true[:, :2]), NEAR)]
        off = [
            np.min([np.abs(plane.elevation(near[:, :2]) - near[:, 2]) for plane in planes], axis=0)
            for planes in (free, topology.planes)
            if planes
        ]
        yield Adjusted(name, topology, np.column_stack(off) if off else np.zeros((0, 2)))


def condition_table(roofs: Sequence[Adjusted], *, each: bool) -> str:
    """Return a line per roof if asked for, and one of all: held / refused by kind, errors [m]."""
    groups = {one.name: [other for other in roofs if other.name == one.name] for one in roofs if each}
    rows = []
    for name, group in (groups | {"all": list(roofs)}).items():
        held, refused = (
            Counter(one.kind for roof in group for one in getattr(roof.topology, what))
            for what in ("held", "refused")
        )
        off = np.concatenate([roof.off for roof in group])
        off = off[off.min(axis=1, initial=np.inf) < NEAR]
        errors = np.sqrt(np.mean(off**2, axis=0)) if len(off) else (np.nan, np.nan)
        cells = [f"{held[kind]} / {refused[kind]}" for kind in CONDITION_KINDS]
        rows.append([name, *cells, str(len(off)), *(f"{error:.3f}" for error in errors)])
    return table(("roof", *CONDITION_KINDS, "corners", "free [m]", "adjusted [m]"), rows)


def print_conditions(seeds: Sequence[int], data: Path) -> None:
    """Print both tables: drawn roofs one by one, virtual ones together."""
    drawn = [(roof.name, roof.points, roof.drawn.corners) for roof in drawn_roofs(data / FOLDER)]
    scenes = [virtual_scene(name, seed) for seed in seeds for name in sorted(SHAPES.keys() - set(ROUND))]
    virtual = [(scene.name, scene.points, scene.wireframe.corners) for scene in scenes]
    for roofs, each in ((drawn, True), (virtual, False)):
        print(
            condition_table([one for roof in roofs for one in adjusted_roofs(*roof)], each=each), end="\n\n"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[11], metavar="N", help="draws (11)")
    parser.add_argument(
        "--set", nargs="+", default=["regularisation.correct_bias=true"], metavar="STAGE.NAME=VALUE"
    )
    parser.add_argument("--each", action="store_true", help="by disturbance and shape, too")
    parser.add_argument("--conditions", action="store_true", help="what holds of roofs' planes, instead")
    parser.add_argument("--data", metavar="DIR", help="with --conditions: where the drawn roofs are")
    options = parser.parse_args(arguments)
    logging.disable(logging.WARNING)
    if options.conditions:
        print_conditions(options.seeds, data_folder(options.data))
        return
    config = config_of(options.set)
    corners = [one for seed in options.seeds for one in corners_of(seed, config)]
    print(share_table(corners, CORNER_KINDS, "kind"))
    if options.each:
        for name, groups in (("disturbance", ("plain", *KINDS)), ("shape", tuple(sorted(SHAPES)))):
            print(f"\n{share_table(corners, groups, name)}")


if __name__ == "__main__":
    main()
