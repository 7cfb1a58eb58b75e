"""The model of one building: solids at three levels of detail, and its attributes."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.bounds import checked_spacing
from lidar_buildings.core.model.grade import Cause, Doubt, Grade, grade_attributes
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.neighbours.point_spacing import FEW_PROBES, measure_spacing
from lidar_buildings.core.solids.output_grid import (
    GRID,
    elevation_on_grid,
    gridded_outline,
    repaired_outlines,
)
from lidar_buildings.core.solids.plan_graph import MIN_HEIGHT, RoofPiece, matched_coverage
from lidar_buildings.core.solids.planar_subdivision import PlanGraph
from lidar_buildings.core.solids.raising import checked_roof_solid, extrude, extrusion_codes
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.stages.building_model.config import DRAPED, ELEVATIONS, BuildingModelConfig
from lidar_buildings.core.stages.building_model.draping import draped_model
from lidar_buildings.core.stages.building_model.eaves import (
    OverhangingRoof,
    SeenWalls,
    overhanging_roof,
    told_of_faces,
)
from lidar_buildings.core.stages.building_model.grading import doubts_of, evidence_of, level_doubts
from lidar_buildings.core.stages.building_model.partition import partition_outline
from lidar_buildings.core.stages.building_model.precision import (
    Sampling,
    outline_variances,
    precision_attributes,
    told_precision,
)
from lidar_buildings.core.stages.building_model.quality import ModelQuality, measure_model
from lidar_buildings.core.stages.building_model.result import ATTRIBUTES, BuildingModel, RoofFacePatch
from lidar_buildings.core.stages.building_model.spikes import MARGIN, spikes_of
from lidar_buildings.core.stages.roof_topology.result import RoofTopology
from lidar_buildings.core.stages.roof_topology.topology import find_topology
from lidar_buildings.core.surfaces.known_ground import KnownGround


def known_attributes(
    points: FloatArray, outline: Outline, plane_id: NDArray[np.uint16] | None, spacing: float
) -> dict[str, Any]:
    """Return all attributes, those that need a solid still unknown."""
    z = np.sort(points[:, 2])
    elevations = {
        f"roof_elevation_{name}": elevation_at(z, share) if len(z) else None
        for name, share in ELEVATIONS.items()
    }
    return {
        **dict.fromkeys(ATTRIBUTES),
        **elevations,
        "area": _rounded(outline.area),
        "n_points": len(points),
        "point_spacing": _rounded(spacing) if len(points) > 1 else None,
        "n_planes": None if plane_id is None else int(np.count_nonzero(np.bincount(plane_id)[1:])),
        "roof_type": "unknown",
        "lod": "",
        "validity": None,
    }


def elevation_at(z: FloatArray, share: float) -> float:
    """Return a percentile of rising elevations on the output grid [m], as numpy's, which takes 0.1 ms."""
    at = (len(z) - 1) * (share / 100.0)
    low, high = float(z[int(at)]), float(z[min(int(at) + 1, len(z) - 1)])
    part = at - int(at)
    between = low + (high - low) * part if part < 0.5 else high - (high - low) * (1.0 - part)
    return elevation_on_grid(between)


def solid_attributes(lod: str, solid: Solid) -> dict[str, Any]:
    """Return what the finest solid, a valid one, tells by itself."""
    return {"volume": _rounded(solid.volume), "lod": lod, "validity": []}


def roof_attributes(topology: RoofTopology, quality: ModelQuality) -> dict[str, Any]:
    """Return what the roof's planes and the agreement with the points tell."""
    n = sum(plane.n_points for plane in topology.planes)
    square = sum(plane.n_points * plane.rms**2 for plane in topology.planes)
    return {
        "roof_type": topology.roof_type,
        "conditions": topology.told_conditions,
        "rmse": None if quality.rmse is None else _rounded(quality.rmse),
        "coverage": _rounded(quality.coverage),
        "no_data_share": _rounded(quality.no_data_share),
        "plane_sigma": _rounded(math.sqrt(square / n)) if n else None,
    }


def _rounded(value: float) -> float:
    """Round to a tenth of a millimetre: sums may differ in their last digits with the order."""
    return round(float(value), 4)


#: Levels of detail (Biljecki et al. 2016), the finest last.
LOD12, LOD13, LOD20, LOD22, LOD23 = "1.2", "1.3", "2.0", "2.2", "2.3"


@dataclass(frozen=True, eq=False)
class Level:
    """One level of detail: a solid that passes all checks, or why there is none."""

    solid: Solid | None
    codes: tuple[int, ...] = ()  #: what is wrong with the first attempt, empty if there is a solid
    remark: str = ""  #: repair that it took; empty if none
    eaves: OverhangingRoof | None = None  #: of LoD2.3


def level_12(outline: Outline, ground: float, roof: float) -> tuple[Level, Outline]:
    """Raise an outline to one elevation, repaired where rings touch or cross; return it as it was used."""
    codes = extrusion_codes(outline, first := extrude(outline, ground, roof), roof - ground)
    if not codes:
        return Level(first), outline
    for repaired, what in repaired_outlines(outline):
        solid = extrude(repaired, ground, roof)
        if not extrusion_codes(repaired, solid, roof - ground):
            return Level(solid, (), what), repaired
    return Level(None, codes), outline


def level_13(faces: list[RoofFacePatch], elevations: FloatArray, ground: float, coverage: PlanGraph) -> Level:
    """Raise every face to the elevation of its part, equal for the faces of one part [m]."""
    pieces = [RoofPiece(face.rings, (0.0, 0.0, float(z))) for face, z in zip(faces, elevations, strict=True)]
    return _level(*checked_roof_solid(pieces, ground, join_equal=True, coverage=coverage))


def level_22(
    faces: list[RoofFacePatch], ground: float, coverage: PlanGraph, points: FloatArray, spacing: float
) -> Level:
    """Raise every face to its plane; no level if no point explains one of its corners."""
    level = _level(*checked_roof_solid(_pieces(faces), ground, coverage=coverage))
    spikes = spikes_of(level.solid, points, spacing) if level.solid is not None else ()
    floor = elevation_on_grid(ground) + MIN_HEIGHT + GRID  # what was lower was lifted
    far = max((abs(spike.excess) for spike in spikes if spike.xyz[2] > floor), default=0.0)
    return Level(None, remark=f"has a corner {far + MARGIN:.1f} m off all points near") if far else level


def _pieces(faces: list[RoofFacePatch]) -> list[RoofPiece]:
    return [
        RoofPiece(face.rings, (float(face.plane[0]), float(face.plane[1]), float(face.plane[2])))
        for face in faces
    ]


def part_elevations(
    faces: list[RoofFacePatch], points: FloatArray, elevation_of: Callable[[FloatArray], float]
) -> FloatArray:
    """Return the elevation of each face's part for LoD1.3 [m], on the output grid, by `elevation_of`."""
    members: dict[int, list[RoofFacePatch]] = {}
    for face in faces:
        members.setdefault(face.part, []).append(face)
    of_part = {}
    for part, own in members.items():
        rows = np.concatenate([face.rows for face in own])
        if len(rows):
            z = elevation_of(points[rows, 2])
        else:
            corners = [(face.plane, ring) for face in own for ring in face.rings]
            z = float(np.mean([np.mean(ring @ plane[:2] + plane[2]) for plane, ring in corners]))
        of_part[part] = elevation_on_grid(z)
    return np.array([of_part[face.part] for face in faces])


def _level(solid: Solid, codes: tuple[int, ...]) -> Level:
    return Level(None, codes) if codes else Level(solid)


_log = logging.getLogger(__name__)

#: Planes of which a, b and c agree to so many digits are one: they were adjusted as one.
_EQUAL_DIGITS = 6
#: Spacing of points too few to measure it [m].
_ASSUMED_SPACING = 1.0
#: What is said where moved walls would not be valid, or their roof could not be divided.
_NOT_MOVED = "walls stay where they were traced: where the planes would move them they allow no LoD2.2"
#: What is said of a building whose roof was not seen.
_NOT_SEEN = "the roof was not seen whole: one height, by the tops of walls and what was seen of the roof"


@dataclass(frozen=True, eq=False)
class _Roof:
    """What is known of a building before solids are made."""

    points: FloatArray
    outline: Outline
    ground: float
    spacing: float
    topology: RoofTopology
    has_extent: bool
    is_traced: bool
    wall_bias: float
    seen: SeenWalls | None

    @property
    def sampling(self) -> Sampling:
        return Sampling(self.points, self.spacing, self.wall_bias if self.is_traced else None)


def build_model(
    points: ArrayLike,
    outline: Outline,
    config: BuildingModelConfig | None = None,
    *,
    plane_id: ArrayLike | None = None,
    ground_elevation: float | None = None,
    point_spacing: float | None = None,
    is_roof_seen: bool = True,
    is_traced: bool = False,
    wall_bias: float = 0.0,
    beside: FloatArray | None = None,
    seen: SeenWalls | None = None,
    ground: KnownGround | None = None,
) -> BuildingModel:
    """
    Build a building's model at the levels of detail 1.2, 1.3, 2.2 and 2.3 (Biljecki et al. 2016).

    LoD1.2 is the outline raised to one height, LoD1.3 has one height for each part of the roof, LoD2.2 has
    the roof's planes: ridges, hips, valleys and steps divide the outline into faces. LoD2.0, with
    `main_roof`, is the same without dormers and what else stands on the roof. LoD2.3 has its eaves
    overhang the walls as well, if walls were seen from the street. The coordinates are
    rounded as they will be written before a solid is built, so that what is checked is what is written.
    A level that fails its checks is left out, and the reason says so. With `foot` = ``draped`` all stand on
    the terrain as it lies along their walls.

    - `points`, shape (n_points, 3): The building's roof points, in any order [m].
    - `outline`: In the map frame [m].
    - `plane_id`, shape (n_points,), optional: Number of each point's roof plane, 0 = none; without any the
      roof is one plane.
    - `ground_elevation`, optional: Elevation of the ground at the building [m]; without it a height is
      assumed, and the reason says so.
    - `point_spacing`, optional: Measured from the points if not given [m].
    - `is_roof_seen`: Whether the points show the roof; else they are the tops of walls with at most a part of
      it, and LoD1.2 is all that is built.
    - `is_traced`: Whether the outline was traced from the points, so that it is no better than they are.
    - `wall_bias`: By how much the roof's edge is thought to lie outside a traced outline [m].
    - `beside`, shape (n, 2, 2), optional: Walls of buildings that touch it, next to which its own stay [m].
    - `seen`, optional: Walls seen from the street; without any there is no LoD2.3.
    - `ground`, optional: Ground about the building, on which draped models stand.

    ValueError if an array has another shape, or a value is not finite.
    """
    config = config or BuildingModelConfig()
    points = checked_points(points)
    known_planes = plane_id is not None
    plane_id = np.zeros(len(points)) if plane_id is None else plane_id
    plane_id = checked_column("plane_id", plane_id, len(points), np.uint16)
    if point_spacing is not None:
        checked_spacing(point_spacing)
    if ground_elevation is not None and not math.isfinite(ground_elevation):
        raise ValueError(f"ground_elevation = {ground_elevation}: must be finite, or None if unknown")
    order = _rows_in_order(points, plane_id)
    points, plane_id = points[order], plane_id[order]
    outline = gridded_outline(outline)
    spacing = point_spacing or (measure_spacing(points, FEW_PROBES) if len(points) > 1 else _ASSUMED_SPACING)
    attributes = known_attributes(points, outline, plane_id if known_planes else None, spacing)
    if not len(points):
        return _without_solid(attributes, ground_elevation, BuildingStatus.DEGENERATE, "no roof points")
    known = (spacing, ground_elevation, is_traced, wall_bias, beside, seen, attributes, config)
    model = _model(points, plane_id if is_roof_seen else None, outline, *known)
    return draped_model(model, ground) if config.foot == DRAPED else model


def _rows_in_order(points: FloatArray, plane_id: NDArray[np.uint16]) -> IntArray:
    """Return the rows by y, x, z and plane; all but y are looked at only where it is equal."""
    x, y, z = points.T
    order = np.argsort(y)
    is_equal = np.zeros(len(y) + 1, dtype=np.bool_)
    is_equal[1:-1] = y[order[1:]] == y[order[:-1]]
    tied = np.flatnonzero(is_equal[1:] | is_equal[:-1])
    own = order[tied]
    order[tied] = own[np.lexsort((plane_id[own], z[own], x[own], y[own]))]
    return order


def _model(
    points: FloatArray,
    plane_id: NDArray[np.uint16] | None,
    outline: Outline,
    spacing: float,
    ground_elevation: float | None,
    is_traced: bool,
    wall_bias: float,
    beside: FloatArray | None,
    seen: SeenWalls | None,
    attributes: dict[str, Any],
    config: BuildingModelConfig,
) -> BuildingModel:
    """Build the model of a building with points, LoD1.2 first: what fails above leaves that."""
    ground, remark = _ground(points, ground_elevation, config)
    roof, why_raised = attributes[f"roof_elevation_{config.roof_elevation}"], ""
    top = max(roof, elevation_on_grid(ground + MIN_HEIGHT))
    if top > roof:
        why_raised = f"the roof at {roof:.2f} m is not above the ground at {ground:.2f} m: raised"
    lowest, outline = level_12(outline, ground, top)
    attributes |= {"ground_elevation": ground, "height": elevation_on_grid(top - ground)}
    solid = lowest.solid
    if solid is None:
        reason = "the solid fails checks " + ", ".join(map(str, lowest.codes))
        attributes |= {"validity": list(lowest.codes)}
        return _without_solid(attributes, ground, BuildingStatus.NO_SOLID, reason)
    remarks = [remark, why_raised]
    if plane_id is None:
        return _lowest_alone(solid, attributes, [*remarks, _NOT_SEEN, lowest.remark])
    try:
        has_extent = _has_extent(points)
        variances = outline_variances(
            outline, Sampling(points, spacing, wall_bias if is_traced else None), beside
        )
        for own in (variances, None):
            topology = find_topology(points, plane_id, outline, point_spacing=spacing, wall_variances=own)
            stands, its_outline = lowest, outline
            if is_moved := topology.outline is not None and not topology.outline.same_as(outline):
                stands, its_outline = level_12(topology.outline, ground, top)
                if stands.solid is None or stands.remark:
                    continue
            roof = _Roof(
                points, its_outline, ground, spacing, topology, has_extent, is_traced, wall_bias, seen
            )
            levels, faces, why = _finer_levels(roof, stands, config)
            if not is_moved or LOD22 not in levels or levels[LOD22].solid is not None:
                break
        if variances is not None and own is None:
            remarks.append(_NOT_MOVED)
        levels = {LOD12: replace(stands, remark=lowest.remark)} | levels
        return _finished(roof, levels, faces, attributes, [*remarks, why])
    except Exception as error:
        _log.exception("building at (%.1f, %.1f): no finer level than LoD1.2", *outline.exterior[0])
        remarks = [*remarks, f"no finer level than LoD1.2: {error!r}", lowest.remark]
        return _lowest_alone(solid, attributes, remarks)


def _finer_levels(
    roof: _Roof, lowest: Level, config: BuildingModelConfig
) -> tuple[dict[str, Level], dict[str, list[RoofFacePatch]], str]:
    """Return LoD1.3, LoD2.0, LoD2.2 and LoD2.3, the faces of each, and why one is missing."""
    if config.finest_lod == LOD12:
        return {}, {}, "no finer level than LoD1.2 was asked for"
    if not roof.has_extent:
        return {}, {}, f"{len(roof.points)} roof points, too few or all on a line: one height"
    try:
        steps = np.array([one.segment for one in roof.topology.steps]).reshape(-1, 2, 2)
        ridges = np.array([one.segment[:, :2] for one in roof.topology.intersections]).reshape(-1, 2, 2)
        planes, lines = _distinct_planes(roof), (steps, ridges)
        floor = roof.ground + MIN_HEIGHT
        known = (roof.outline, roof.points, planes, lines, roof.spacing, config, floor)
        faces = partition_outline(*known)
        share = ELEVATIONS[config.roof_elevation]
        tops = part_elevations(faces, roof.points, lambda z: elevation_at(np.sort(z), share))
        tops = np.maximum(tops, elevation_on_grid(roof.ground + MIN_HEIGHT))
        coverage = matched_coverage(_pieces(faces), np.arange(len(faces)))
        # A roof in one part is the same at both levels.
        parts = level_13(faces, tops, roof.ground, coverage) if any(face.part for face in faces) else lowest
        levels = {LOD13: parts, LOD22: level_22(faces, roof.ground, coverage, roof.points, roof.spacing)}
        main = partition_outline(*known, is_main=True) if config.main_roof else []
        if main:
            main = min(main, faces, key=len)  # planes that run on may cut one another into more faces
            covered = matched_coverage(_pieces(main), np.arange(len(main)))
            levels[LOD20] = level_22(main, roof.ground, covered, roof.points, roof.spacing)
    except Exception as error:
        _log.exception("building at (%.1f, %.1f): its roof was not divided", *roof.outline.exterior[0])
        return {}, {}, f"the roof could not be divided into faces: {error!r}"
    flat = [RoofFacePatch(f.rings, np.array([0.0, 0.0, z]), f.rows) for f, z in zip(faces, tops, strict=True)]
    by_level = {LOD13: flat, LOD20: main, LOD22: faces}
    if roof.seen is not None and levels[LOD22].solid is not None:
        eaves = overhanging_roof(faces, roof.outline, roof.ground, roof.seen)
        if eaves is not None:
            levels[LOD23] = replace(_level(eaves.solid, eaves.codes), eaves=eaves)
            by_level[LOD23] = eaves.faces
    missing = [
        f"LoD{lod} {level.remark or 'fails checks ' + ', '.join(map(str, level.codes))}"
        for lod, level in levels.items()
        if level.solid is None
    ]
    return levels, by_level, "; ".join(missing)


def _distinct_planes(roof: _Roof) -> FloatArray:
    """Return a, b, c of every plane that is no wall, pieces of one plane once; at least one."""
    equations = np.array([plane.equation for plane in roof.topology.planes if not plane.is_wall])
    if not len(equations):
        return np.array([[0.0, 0.0, np.median(roof.points[:, 2])]])
    rounded = map(tuple, np.round(equations, _EQUAL_DIGITS).tolist())
    first = {one: row for row, one in reversed(list(enumerate(rounded)))}
    return equations[sorted(first.values())]


def _finished(
    roof: _Roof,
    levels: dict[str, Level],
    faces: dict[str, list[RoofFacePatch]],
    attributes: dict[str, Any],
    remarks: list[str],
) -> BuildingModel:
    """Gather the solids and what is measured on the finest."""
    solids = {lod: level.solid for lod, level in levels.items() if level.solid is not None}
    finest = max(solids)
    if finest == LOD12:
        whole = np.array([0.0, 0.0, solids[LOD12].vertices[:, 2].max()])
        faces = {LOD12: [RoofFacePatch(roof.outline.rings, whole, np.arange(len(roof.points)))]}
    measured = LOD22 if finest == LOD23 else finest  # as seen from above
    quality = measure_model(faces[measured], solids[measured], roof.points, roof.outline, roof.spacing)
    evidence = evidence_of(roof.points, roof.outline, roof.spacing, quality.support)
    doubts = [*level_doubts(measured, roof.has_extent), *doubts_of(evidence, roof.is_traced)]
    attributes = attributes | roof_attributes(roof.topology, quality)
    attributes |= solid_attributes(finest, solids[finest])
    reason = "; ".join(text for text in (*remarks, levels[LOD12].remark) if text)
    status = BuildingStatus.OK if roof.has_extent else BuildingStatus.DEGENERATE
    of_faces: dict[str, tuple[dict[str, Any], ...]] = {}
    if roof.seen is not None:
        of_faces = {
            lod: told_of_faces(solid, roof.seen.walls, levels[lod].eaves) for lod, solid in solids.items()
        }
    for lod in sorted({LOD22, LOD23} & solids.keys()):
        sure = told_precision(solids[lod], roof.topology, roof.outline, roof.sampling)
        of_street = of_faces.get(lod, ({},) * len(sure))
        of_faces[lod] = tuple(one | other for one, other in zip(sure, of_street, strict=True))
        attributes |= precision_attributes(sure)
    return _graded(BuildingModel(solids, attributes, status, reason, of_faces=of_faces), doubts)


def _lowest_alone(solid: Solid, attributes: dict[str, Any], remarks: list[str]) -> BuildingModel:
    """Return the model of a building whose LoD1.2 is sound and of which no more could be told."""
    attributes = attributes | solid_attributes(LOD12, solid)
    reason = "; ".join(text for text in remarks if text)
    return _graded(BuildingModel({LOD12: solid}, attributes, BuildingStatus.OK, reason), level_doubts(LOD12))


def _graded(model: BuildingModel, doubts: Iterable[Doubt]) -> BuildingModel:
    doubts = tuple(doubts)
    return replace(model, doubts=doubts, attributes=model.attributes | grade_attributes(doubts))


def _has_extent(points: FloatArray) -> bool:
    if len(points) < 3:
        return False
    x, y = points[:, 0] - points[0, 0], points[:, 1] - points[0, 1]
    x, y = x - x.sum() / len(x), y - y.sum() / len(y)
    # Not `dot`: for many points it wakes threads that then wait on a core for more.
    xx, xy, yy = (float(np.einsum("i,i", *each)) for each in ((x, x), (x, y), (y, y)))
    # The product of the eigenvalues against the square of their sum.
    return xx * yy - xy * xy > 1e-12 * (xx + yy) ** 2


def _without_solid(
    attributes: dict[str, Any], ground: float | None, status: BuildingStatus, reason: str
) -> BuildingModel:
    known = None if ground is None else elevation_on_grid(ground)
    doubts = [Doubt(Cause.NO_MODEL, reason, Grade.POOR)]
    return _graded(BuildingModel({}, attributes | {"ground_elevation": known}, status, reason), doubts)


def _ground(
    points: FloatArray, ground_elevation: float | None, config: BuildingModelConfig
) -> tuple[float, str]:
    """Return the elevation that the solid stands on, and what to remark about it."""
    if ground_elevation is not None:
        return elevation_on_grid(ground_elevation), ""
    assumed = elevation_on_grid(float(points[:, 2].min()) - config.assumed_height)
    return assumed, f"ground elevation unknown: taken {config.assumed_height:g} m below the lowest roof point"
