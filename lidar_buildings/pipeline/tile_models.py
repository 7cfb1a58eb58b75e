"""The models of a tile's buildings, with all that files say about them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import shapely

from lidar_buildings.core.model import classes
from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.grade import Cause, Doubt, Grade, grade_attributes
from lidar_buildings.core.model.ids import anchor_near, anchor_row, rows_by_building
from lidar_buildings.core.model.outline import BuildingOutline, OutlineQuality, ring_walls
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.solids.output_grid import elevation_on_grid
from lidar_buildings.core.stages.building_model.config import DRAPED, BuildingModelConfig
from lidar_buildings.core.stages.building_model.eaves import SeenWalls
from lidar_buildings.core.stages.building_model.grading import BESIDE, beside_doubts, ground_doubts
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.building_model.result import ATTRIBUTES, BuildingModel
from lidar_buildings.core.stages.facades.facade import NO_BUILDING, Facade
from lidar_buildings.core.stages.footprints.footprints import remark_on_points
from lidar_buildings.core.surfaces.known_ground import KnownGround
from lidar_buildings.pipeline.building_pool import BuildingPool, map_buildings

#: What models and their attributes are made from.
_NEEDED = {"classification", "facade", "height_above_ground", "plane_id"}


#: Traced outlines nearer to each other than this share walls; ground so far about a building is its own [m].
_SHARED, _ABOUT = 0.01, 10.0
#: What of a roof lies so far below the tops of bare walls is of a lower part of the building [m].
_LEVEL = 1.0


@dataclass(frozen=True, eq=False)
class TileModel:
    """One building's model with everything that files say about it."""

    building_id: int  #: see `lidar_buildings.core.model.ids`
    anchor: tuple[float, float]  #: the anchor point's x and y in the map frame [m]
    model: BuildingModel  #: solids and roof faces
    attributes: dict[str, Any]  #: the attributes of doc/formats.md, by name


def build_models(
    tile: PointTile,
    outlines: tuple[BuildingOutline, ...],
    config: BuildingModelConfig,
    pool: BuildingPool | None = None,
    *,
    facades: Sequence[Facade] = (),
) -> tuple[TileModel, ...]:
    """
    Build the model of every outline from the tile's points that carry its id.

    The points have `building_id` and `plane_id`, the outlines their quality, if it is known. Models are built
    in `pool`; here, one after the other, if not given. `facades` are walls seen from the street, which give
    their buildings LoD2.3.
    """
    seen = _seen_walls(facades)
    rows_of = dict(rows_by_building(tile.building_id)) if tile.building_id is not None else {}
    no_rows = np.zeros(0, dtype=np.intp)
    needed = tile.with_columns(**dict.fromkeys(tile.columns.keys() - _NEEDED))
    ordered = sorted(outlines, key=lambda one: one.building_id)
    buildings = [needed.select(rows_of.get(one.building_id, no_rows)) for one in ordered]
    grounds: Sequence[KnownGround | None] = [None] * len(ordered)
    if config.foot == DRAPED:
        grounds = _known_grounds(buildings, ordered)
    jobs = [
        (one.building_id, _job(part, one, config, seen.get(one.building_id), ground, walls))
        for one, part, ground, walls in zip(ordered, buildings, grounds, _walls_beside(ordered), strict=True)
    ]

    def failed(k: int, reason: str) -> BuildingModel:
        known: dict[str, Any] = dict.fromkeys(ATTRIBUTES) | {
            "lod": "",
            "roof_type": "unknown",
        }
        points, outline, _ = jobs[k][1].args
        doubts = (Doubt(Cause.NO_MODEL, reason, Grade.POOR),)
        known |= {"area": outline.area, "n_points": len(points)}
        return BuildingModel({}, known, BuildingStatus.FAILED, reason, doubts)

    models = map_buildings(pool, jobs, list(map(len, buildings)), failed, "no model was built")
    beside, n_ground = _points_beside(tile, ordered), _ground_within(tile, ordered)
    return tuple(map(_with_attributes, buildings, ordered, models, beside, n_ground))


def _ground_under(building: PointTile) -> FloatArray:
    """Return the ground at each of a building's points, shape (n_points, 3); none if heights are unknown."""
    height = building.height_above_ground
    return building.points[:0] if height is None else building.points - np.outer(height, (0.0, 0.0, 1.0))


def _known_grounds(
    buildings: Sequence[PointTile], outlines: Sequence[BuildingOutline]
) -> list[KnownGround | None]:
    """Return the ground about each building, of those of one block the same at the walls that they share."""
    block = np.arange(len(outlines))
    traced = np.flatnonzero([one.ground_elevation is None for one in outlines])  # no tile parts their blocks
    plans = np.array([outlines[k].outline.polygon for k in traced], dtype=object)
    pairs = shapely.STRtree(plans).query(plans, predicate="dwithin", distance=_SHARED)
    block[traced] = traced[sets_of_pairs(len(traced), *pairs)]
    places = list(map(_ground_under, buildings))
    found: list[KnownGround | None] = [None] * len(outlines)
    for number in np.unique(block):
        members = np.flatnonzero(block == number)
        of_block = np.concatenate([places[k] for k in members])
        if len(of_block):
            ground = KnownGround.at(of_block)
            for k in members[[len(outlines[k].outline.exterior) > 0 for k in members]]:
                ring = outlines[k].outline.exterior
                found[k] = ground.within(ring.min(axis=0) - _ABOUT, ring.max(axis=0) + _ABOUT)
    return found


def _walls_beside(outlines: Sequence[BuildingOutline]) -> list[FloatArray]:
    """Return the walls of the buildings that touch each, shape (n, 2, 2) [m]; no tile parts their blocks."""
    plans = np.array([one.outline.polygon for one in outlines], dtype=object)
    pairs = shapely.STRtree(plans).query(plans, predicate="dwithin", distance=_SHARED).T
    beside: list[list[FloatArray]] = [[] for _ in outlines]
    for one, other in pairs[pairs[:, 0] != pairs[:, 1]].tolist():
        beside[one].append(ring_walls(outlines[other].outline.rings))
    return [np.concatenate([np.empty((0, 2, 2)), *walls]) for walls in beside]


def _points_beside(tile: PointTile, outlines: Sequence[BuildingOutline]) -> list[FloatArray]:
    """Return the roof points about each footprint that no footprint has; none about a traced outline."""
    beside = [np.empty((0, 3))] * len(outlines)
    if tile.building_id is None or all(one.ground_elevation is None for one in outlines):
        return beside
    free = tile.points[tile.is_roof & (tile.building_id == 0)]
    free = free[np.argsort(free[:, 0], kind="stable")]
    for k, one in enumerate(outlines):
        if one.ground_elevation is not None and len(one.outline.exterior):
            low, high = one.outline.exterior.min(axis=0) - BESIDE, one.outline.exterior.max(axis=0) + BESIDE
            rows = slice(*np.searchsorted(free[:, 0], (low[0], high[0])))
            beside[k] = free[rows][(free[rows, 1] >= low[1]) & (free[rows, 1] <= high[1])]
    return beside


def _ground_within(tile: PointTile, outlines: Sequence[BuildingOutline]) -> list[int]:
    """Return how many points of the ground lie within each footprint; 0 for traced outlines."""
    if tile.classification is None or all(one.ground_elevation is None for one in outlines):
        return [0] * len(outlines)
    ground = tile.points[tile.classification == PointClass.GROUND, :2]
    ground = ground[np.argsort(ground[:, 0], kind="stable")]
    found = []
    for one in outlines:
        plan = one.outline.polygon if one.ground_elevation is not None else shapely.Polygon()
        west, _, east, _ = plan.bounds if plan.area else (0.0, 0.0, 0.0, 0.0)
        near = ground[slice(*np.searchsorted(ground[:, 0], (west, east)))]
        found.append(int(np.count_nonzero(shapely.contains_xy(plan, *near.T))))
    return found


def _is_closed(building: PointTile, one: BuildingOutline) -> bool:
    """Whether an outline was closed behind walls; a footprint, beside walls or not, knows its ground."""
    return building.has_bare_walls and one.ground_elevation is None


def _seen_walls(facades: Sequence[Facade]) -> dict[int, SeenWalls]:
    """Return what was seen of the walls of each building, by its id."""
    by_building: dict[int, list[Facade]] = {}
    for one in facades:
        by_building.setdefault(one.building_id, []).append(one)
    by_building.pop(NO_BUILDING, None)
    seen = {}
    for number, own in by_building.items():
        lines = [line for one in own for line, is_seen in one.stretches if is_seen]
        edges = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
        seen[number] = SeenWalls(
            np.concatenate([np.empty((0, 2, 2)), *edges]), np.concatenate([one.under_eaves for one in own])
        )
    return seen


def _job(
    building: PointTile,
    one: BuildingOutline,
    config: BuildingModelConfig,
    seen: SeenWalls | None,
    ground: KnownGround | None,
    beside: FloatArray,
) -> partial[BuildingModel]:
    points, plane_id, foot = building.points, building.plane_id, one.ground_elevation
    is_closed = _is_closed(building, one)
    if is_closed:  # of points those that tell the height of the walls, or lie above them
        is_bare, z = building.facade == classes.FacadeClass.BARE, points[:, 2]
        points, plane_id = points[is_bare | (z >= np.median(z[is_bare]) - _LEVEL)], None
    if len(under := _ground_under(building)):
        foot = float(under[:, 2].min())
    return partial(
        build_model,
        points,
        one.outline,
        config,
        plane_id=plane_id,
        ground_elevation=foot,
        is_roof_seen=not is_closed,
        is_traced=one.ground_elevation is None,
        wall_bias=one.quality.bias if one.quality else 0.0,
        beside=beside,
        seen=seen,
        ground=ground,
    )


def _outline_doubts(quality: OutlineQuality | None) -> Iterator[Doubt]:
    """Yield what became of the outline before."""
    if quality is None or quality.status is BuildingStatus.OK:
        return
    cause = Cause.CUT_OFF if quality.status is BuildingStatus.CUT_OFF else Cause.TRACED_OUTLINE
    yield Doubt(cause, quality.reason or quality.status.value)


def _with_attributes(
    building: PointTile, one: BuildingOutline, model: BuildingModel, beside: FloatArray, n_ground: int
) -> TileModel:
    is_closed = _is_closed(building, one)
    remark = "" if is_closed else remark_on_points(building)
    reason = "; ".join(text for text in (remark, model.reason) if text)
    attributes = {"building_id": one.building_id, **model.attributes}
    attributes.update(status=model.status.value, reason=reason)
    if len(under := _ground_under(building)):
        lowest, highest = map(elevation_on_grid, (under[:, 2].min(), under[:, 2].max()))
        attributes.update(ground_elevation_min=lowest, ground_elevation_max=highest)
    if (quality := one.quality) is not None:
        attributes.update(outline_sigma=quality.sigma, outline_max_offset=quality.max_offset)
        if quality.reason:
            attributes["reason"] = "; ".join(filter(None, (reason, quality.reason)))
        if model.status is BuildingStatus.OK:  # the model's own failure outweighs the outline's
            attributes["status"] = quality.status.value
    if is_closed:  # its ring was drawn, not traced
        attributes.update(outline_sigma=None, outline_max_offset=None)
    outside = beside_doubts(
        one.outline, model.solids.get(model.attributes["lod"]), beside, model.attributes["point_spacing"]
    )
    on_ground = ground_doubts(n_ground, len(building)) if model.solids else ()
    doubts = [*model.doubts, *on_ground, *outside, *_outline_doubts(one.quality)]
    attributes.update(grade_attributes(doubts))
    ring = one.outline.exterior
    west = ring.min(axis=0) if len(ring) else np.zeros(2)
    if len(building):
        west = building.points[anchor_row(building.points)]
    return TileModel(one.building_id, anchor_near(one.building_id, west), model, attributes)
