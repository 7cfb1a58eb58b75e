"""The models of a tile's buildings, with all that files say about them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.classes import Facade
from lidar_buildings.core.model.ids import anchor_near, anchor_row, rows_by_building
from lidar_buildings.core.model.outline import BuildingOutline, Outline, OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.building_model.result import ATTRIBUTES, BuildingModel
from lidar_buildings.core.stages.footprints.footprints import remark_on_points
from lidar_buildings.pipeline.building_pool import BuildingPool, map_buildings

#: What models and their attributes are made from.
_NEEDED = {"classification", "facade", "height_above_ground", "plane_id"}


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
) -> tuple[TileModel, ...]:
    """
    Build the model of every outline from the tile's points that carry its id.

    The points have `building_id` and `plane_id`, the outlines their quality, if it is known. Models are built
    in `pool`; here, one after the other, if not given.
    """
    rows_of = dict(rows_by_building(tile.building_id)) if tile.building_id is not None else {}
    no_rows = np.zeros(0, dtype=np.intp)
    needed = tile.with_columns(**dict.fromkeys(tile.columns.keys() - _NEEDED))
    ordered = sorted(outlines, key=lambda one: one.building_id)
    buildings = [needed.select(rows_of.get(one.building_id, no_rows)) for one in ordered]
    jobs = [_job(part, one, config) for one, part in zip(ordered, buildings, strict=True)]
    sizes = [len(part) for part in buildings]
    models = map_buildings(pool, _built, jobs, sizes, _failed, "no model was built")
    return tuple(map(_with_attributes, buildings, ordered, models))


def _is_closed(building: PointTile, one: BuildingOutline) -> bool:
    """Whether an outline was closed behind walls; a footprint, beside walls or not, knows its ground."""
    return building.has_bare_walls and one.ground_elevation is None


def _tell_height(building: PointTile) -> NDArray[np.bool_]:
    """Tell which points are at the level of the walls that the scanner saw no roof over, or above it."""
    is_bare, z = building.facade == Facade.BARE, building.points[:, 2]
    return is_bare | (z >= np.median(z[is_bare]) - _LEVEL)


class _Job(NamedTuple):
    building_id: int
    points: FloatArray
    outline: Outline
    plane_id: NDArray[np.uint16] | None
    ground_elevation: float | None
    is_closed: bool
    config: BuildingModelConfig


def _job(building: PointTile, one: BuildingOutline, config: BuildingModelConfig) -> _Job:
    points, plane_id, is_closed = building.points, building.plane_id, _is_closed(building, one)
    if is_closed:
        points, plane_id = points[_tell_height(building)], None
    ground = _ground_elevation(building, one)
    return _Job(one.building_id, points, one.outline, plane_id, ground, is_closed, config)


def _built(job: _Job) -> BuildingModel:
    return build_model(
        job.points,
        job.outline,
        job.config,
        plane_id=job.plane_id,
        ground_elevation=job.ground_elevation,
        is_roof_seen=not job.is_closed,
    )


def _failed(job: _Job, reason: str) -> BuildingModel:
    known: dict[str, Any] = dict.fromkeys(ATTRIBUTES)
    known |= {"area": job.outline.area, "n_points": len(job.points), "roof_type": "unknown"}
    known |= {"lod": "", "validity": ""}
    return BuildingModel({}, known, BuildingStatus.FAILED, reason)


def _with_attributes(building: PointTile, one: BuildingOutline, model: BuildingModel) -> TileModel:
    is_closed = _is_closed(building, one)
    remark = "" if is_closed else remark_on_points(building)
    reason = "; ".join(text for text in (remark, model.reason) if text)
    attributes = {"building_id": one.building_id, **model.attributes}
    attributes.update(status=model.status.value, reason=reason)
    if one.quality is not None:
        attributes.update(_outline_attributes(model, reason, one.quality))
    if is_closed:  # its ring was drawn, not traced
        attributes.update(outline_sigma=None, outline_max_offset=None)
    return TileModel(one.building_id, anchor_near(one.building_id, _west(building, one)), model, attributes)


def _west(building: PointTile, one: BuildingOutline) -> NDArray[np.float64]:
    """Return the westernmost point of a building, without points the corner of its ring's limits."""
    if len(building):
        return building.points[anchor_row(building.points)]
    return one.outline.exterior.min(axis=0) if len(one.outline.exterior) else np.zeros(2)


def _outline_attributes(model: BuildingModel, reason: str, quality: OutlineQuality) -> dict[str, Any]:
    """Return what the outline's quality adds; the model's own failure outweighs the outline's."""
    attributes: dict[str, Any] = {"outline_sigma": quality.sigma, "outline_max_offset": quality.max_offset}
    if quality.reason:
        attributes["reason"] = "; ".join(filter(None, (reason, quality.reason)))
    if model.status is BuildingStatus.OK:
        attributes["status"] = quality.status.value
    return attributes


def _ground_elevation(building: PointTile, one: BuildingOutline) -> float | None:
    """Return the lowest ground under a building's points [m], else what its outline knows of the ground."""
    if building.height_above_ground is None or not len(building):
        return one.ground_elevation
    return float(np.min(building.points[:, 2] - building.height_above_ground))
