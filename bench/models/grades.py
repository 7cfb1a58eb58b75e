"""
How well grades find the models that are off, and how often they suspect others.

    python -m bench.models.grades [--data DIR] [--seeds N ...] [--roofs virtual drawn] [--others] [--each]

Virtual roofs and those that people drew, as they are and disturbed (`grade_cases`), on their true outline,
on wrong footprints, and traced. A model is off if it differs from the truth on more than 5 % of the union of
both plans: by more than 0.5 m in height, or where one of them is alone (`grade_truth`). Recall: share of
those off that are `check` or `poor`; false alarms: share of the others that are.
"""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from bench.common.arguments import data_parser
from bench.common.clouds import data_folder
from bench.common.tables import percent, table
from bench.models.grade_cases import Case, cases_of, roofs
from bench.models.grade_truth import OFF_SHARE, Difference, difference
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.grade import Cause, Grade, causes_in
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.pipeline import tile_models, tile_outlines, tile_stages, tile_tracing
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.tile_models import TileModel

HEADINGS = ("cases", "off", "found", "recall", "poor", "not off", "flagged", "false alarms", "poor")
_NUMBER = 7
#: So near to the limit [share] it is chance, also how exactly somebody drew, on which side of it a model is.
_UNDECIDED = 0.01


class Graded(NamedTuple):
    """A case's models against its truth."""

    case: Case
    difference: Difference
    grade: Grade  #: the worst of the models; POOR without one
    causes: tuple[str, ...]
    models: tuple[TileModel, ...]

    @property
    def is_off(self) -> bool:
        """Whether they are off."""
        return self.difference.is_off


def models_of(case: Case, config: PipelineConfig) -> tuple[TileModel, ...]:
    """Take a case through the chain, from segmentation on or on its footprint."""
    ground = case.ground_points
    points = np.concatenate([case.points, ground])
    is_roof = np.arange(len(points)) < len(case.points)
    tile = PointTile(
        points,
        classification=np.where(is_roof, PointClass.BUILDING, PointClass.GROUND).astype(np.uint8),
        height_above_ground=points[:, 2] - case.ground,
    )
    if case.outline is None:
        tile = tile.select(is_roof)
        found = tile_tracing.trace_buildings(tile, config.segmentation, config.boundary_tracing)
        outlines, tile = tile_outlines.regularise_outlines(found.outlines, config.regularisation), found.tile
    else:
        is_own = is_roof & shapely.contains_xy(case.outline.polygon, *points[:, :2].T)
        tile = tile.with_columns(building_id=np.where(is_own, _NUMBER, 0).astype(np.uint32))
        outlines = (BuildingOutline(_NUMBER, case.outline.as_carried(), float(np.float32(case.ground))),)
    return tile_models.build_models(
        tile_stages.fit_planes(tile, config.plane_fitting), outlines, config.building_model
    )


def graded(case: Case, config: PipelineConfig) -> Graded:
    """Grade a case and measure what is true of it."""
    models = models_of(case, config)
    solids = [one.model.solids[max(one.model.solids)] for one in models if one.model.solids]
    grades = [Grade(one.attributes["quality"]) for one in models] or [Grade.POOR]
    causes = {cause for one in models for cause in causes_in(one.attributes["quality_reasons"])}
    causes |= set() if models else {Cause.NO_MODEL.value}
    worst = max(grades, key=list(Grade).index)
    return Graded(case, difference(solids, case.truth), worst, tuple(sorted(causes)), models)


def all_graded(options: argparse.Namespace) -> Iterator[Graded]:
    """Yield all cases of the seeds that are asked for."""
    data, config = data_folder(options.data), PipelineConfig()
    for seed in options.seeds:
        for roof in roofs(data, seed, options.roofs):
            if zlib.crc32(f"{seed} {roof.name}".encode()) % options.every == 0:
                yield from (graded(case, config) for case in cases_of(roof, seed, options.others))


def grade_table(found: Sequence[Graded]) -> str:
    """Return a line per kind of roof and of what is wrong with it, of all, and of clear cases."""
    groups: dict[str, list[Graded]] = {}
    for one in found:
        origin = "drawn" if one.case.name.startswith("drawn") else "virtual"
        names = [f"{origin}, {one.case.kind}", f"{origin}, all", "all"]
        if abs(one.difference.total - OFF_SHARE) > _UNDECIDED:
            names.append(f"{origin}, clear")
        for name in names:
            groups.setdefault(name, []).append(one)
    return table(("roofs", *HEADINGS), ([name, *_cells(group)] for name, group in sorted(groups.items())))


def cause_table(found: Sequence[Graded]) -> str:
    """Return what each reason is worth: who has it, and what grades find without it."""
    off, fine = ([one for one in found if one.is_off == is_off] for is_off in (True, False))

    def shares(without: str) -> list[str]:
        kept = ([set(one.causes) - {without} for one in part] for part in (off, fine))
        return [percent(sum(map(bool, part)) / max(len(part), 1)) for part in kept]

    causes = sorted({cause for one in found for cause in one.causes})
    rows = [
        ["(all)", *(str(sum(map(bool, (one.causes for one in part)))) for part in (off, fine)), *shares("")]
    ]
    for cause in causes:
        n = [str(sum(cause in one.causes for one in part)) for part in (off, fine)]
        rows.append([cause, *n, *shares(cause)])
    return table(("reason", "off", "not off", "recall without it", "false alarms without it"), rows)


def _cells(group: Sequence[Graded]) -> list[str]:
    off, fine = ([one for one in group if one.is_off == is_off] for is_off in (True, False))
    cells = [str(len(group))]
    for part in (off, fine):
        n, flagged = len(part), sum(one.grade is not Grade.GOOD for one in part)
        poor = sum(one.grade is Grade.POOR for one in part)
        cells += [str(n), str(flagged), percent(flagged / n) if n else "–", str(poor)]
    return cells


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = data_parser(__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[101], metavar="N", help="draws (101)")
    parser.add_argument("--roofs", nargs="+", default=["virtual", "drawn"], choices=("virtual", "drawn"))
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only one roof in N")
    parser.add_argument("--others", action="store_true", help="disturbances that no threshold was chosen on")
    parser.add_argument("--each", action="store_true", help="print a line per case, too")
    options = parser.parse_args(arguments)
    found = list(all_graded(options))
    for one in found if options.each else ():
        share, causes = one.difference.total, " ".join(one.causes)
        print(f"{one.case.name}, {one.case.kind}: off {share:.3f}, {one.grade.value}: {causes}")
    print(grade_table(found), end="\n\n")
    print(cause_table(found))


if __name__ == "__main__":
    main()
