"""The models of a tile's buildings, with all that files say about them."""

from __future__ import annotations

import logging
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.ids import anchor_near, anchor_row
from lidar_buildings.core.model.outline import BuildingOutline, OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.parallel import work_alone
from lidar_buildings.core.stages.building_model import (
    ATTRIBUTES,
    BuildingModel,
    BuildingModelConfig,
    build_model,
)
from lidar_buildings.core.stages.footprints import remark_on_points
from lidar_buildings.pipeline.tile_stages import rows_by_building

_log = logging.getLogger(__name__)

#: A building with so many points is worth a thread of its own.
_LARGE = 4000


@dataclass(frozen=True, eq=False)
class TileModel:
    """
    One building's model with everything that files say about it.

    Attributes
    ----------
    building_id : int
        See `lidar_buildings.core.model.ids`.
    anchor : tuple of two float
        The anchor point's x and y in the map frame [m].
    model : BuildingModel
        Solids and roof faces.
    attributes : dict
        The attributes of DESIGN.md section 3, by name.
    """

    building_id: int
    anchor: tuple[float, float]
    model: BuildingModel
    attributes: dict[str, Any]


def build_models(
    tile: PointTile, outlines: tuple[BuildingOutline, ...], config: BuildingModelConfig
) -> tuple[TileModel, ...]:
    """
    Build the model of every outline from the tile's points that carry its id.

    Parameters
    ----------
    tile : PointTile
        Building points with `building_id` and `plane_id`.
    outlines : tuple of BuildingOutline
        With their quality, if it is known.
    config : BuildingModelConfig
        Of the models.
    """
    rows_of = dict(rows_by_building(tile.building_id)) if tile.building_id is not None else {}
    no_rows = np.zeros(0, dtype=np.intp)

    def model(one: BuildingOutline) -> TileModel:
        building = tile.select(rows_of.get(one.building_id, no_rows))
        return _model(building, one, config)

    # Numpy's many small calls for a house would only keep each other waiting; blocks are worth a core each.
    size = {one.building_id: len(rows_of.get(one.building_id, no_rows)) for one in outlines}
    large = [one for one in outlines if size[one.building_id] >= _LARGE]
    with ThreadPoolExecutor(max_workers=os.cpu_count(), initializer=work_alone) as pool:
        models = list(pool.map(model, sorted(large, key=lambda one: -size[one.building_id])))
    models += [model(one) for one in outlines if size[one.building_id] < _LARGE]
    return tuple(sorted(models, key=lambda each: each.building_id))


def _model(building: PointTile, one: BuildingOutline, config: BuildingModelConfig) -> TileModel:
    """Build one model and gather its attributes."""
    model = _built(building, one, config)
    reason = "; ".join(text for text in (remark_on_points(building), model.reason) if text)
    attributes = {"building_id": one.building_id, **model.attributes}
    attributes.update(status=model.status.value, reason=reason)
    if one.quality is not None:
        attributes.update(_outline_attributes(model, reason, one.quality))
    return TileModel(one.building_id, anchor_near(one.building_id, _west(building, one)), model, attributes)


def _built(building: PointTile, one: BuildingOutline, config: BuildingModelConfig) -> BuildingModel:
    """Build one model; whatever goes wrong, one comes back that says so."""
    try:
        return build_model(
            building.points,
            one.outline,
            config,
            plane_id=building.plane_id,
            ground_elevation=_ground_elevation(building, one),
        )
    except Exception as error:
        _log.exception("building %d: no model was built", one.building_id)
        known: dict[str, Any] = dict.fromkeys(ATTRIBUTES)
        known |= {"area": one.outline.area, "n_points": len(building), "roof_type": "unknown"}
        known |= {"lod": "", "validity": ""}
        return BuildingModel({}, known, (), BuildingStatus.FAILED, f"unexpected error: {error!r}")


def _west(building: PointTile, one: BuildingOutline) -> NDArray[np.float64]:
    """Return the westernmost point of a building, without points the corner of its ring's limits."""
    if len(building):
        return building.points[anchor_row(building.points)]
    return one.outline.exterior.min(axis=0) if len(one.outline.exterior) else np.zeros(2)


def _outline_attributes(model: BuildingModel, reason: str, quality: OutlineQuality) -> dict[str, Any]:
    """Return what the outline's quality adds; the model's own failure outweighs the outline's."""
    attributes: dict[str, Any] = {"outline_sigma": quality.sigma, "outline_max_offset": quality.max_offset}
    if quality.status is not BuildingStatus.OK:
        reasons = [each for each in (reason, quality.reason) if each]
        status = quality.status if model.status is BuildingStatus.OK else model.status
        attributes.update(status=status.value, reason="; ".join(reasons))
    return attributes


def _ground_elevation(building: PointTile, one: BuildingOutline) -> float | None:
    """Return the lowest ground under a building's points [m], else what its outline knows of the ground."""
    if building.height_above_ground is None or not len(building):
        return one.ground_elevation
    return float(np.min(building.points[:, 2] - building.height_above_ground))
