"""Models whose foot follows the terrain."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

from lidar_buildings.core.solids.foot import draped_solid
from lidar_buildings.core.solids.plan_graph import MIN_HEIGHT
from lidar_buildings.core.solids.shell import GROUND_SURFACE, Solid
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.core.surfaces.known_ground import KnownGround

_log = logging.getLogger(__name__)


def draped_model(model: BuildingModel, ground: KnownGround | None) -> BuildingModel:
    """
    Return a model that stands on level ground with the foot of its solids on the terrain.

    The volume follows. A solid that would not be valid stands level as before; `reason` says so, and where
    the foot had to be cut below the roof.
    """
    if not model.solids:
        return model
    if ground is None:
        return _with_reason(model, "the ground at its walls is not known: it stands level")
    each = {id(solid): solid for solid in model.solids.values()}  # of a roof in one part two are the same
    tried = {number: _on_terrain(solid, ground) for number, solid in each.items()}
    found = {lod: tried[id(solid)] for lod, solid in model.solids.items()}
    solids = {lod: solid for lod, (solid, _, _) in found.items()}
    cut = ", ".join(lod for lod, (_, is_cut, _) in found.items() if is_cut)
    remarks = [f"LoD{lod} stands level: {why}" for lod, (_, _, why) in found.items() if why]
    if cut:
        remarks.append(f"the terrain rises to the roof of LoD{cut}: the foot ends {MIN_HEIGHT:g} m below")
    of_faces = {
        lod: _told_again(model.of_faces[lod], model.solids[lod], solids[lod]) for lod in model.of_faces
    }
    attributes = model.attributes | {"volume": round(solids[max(solids)].volume, 4)}
    return _with_reason(replace(model, solids=solids, attributes=attributes, of_faces=of_faces), *remarks)


def _on_terrain(solid: Solid, ground: KnownGround) -> tuple[Solid, bool, str]:
    """Return a solid on the terrain, if it can be, whether its foot was cut, and why it stands level."""
    try:
        draped, is_cut = draped_solid(solid, ground.elevation)
        codes = check_solid(draped)
    except Exception as error:
        _log.exception("building at (%.1f, %.1f): it stands level", *solid.vertices[0, :2])
        return solid, False, repr(error)
    if codes:
        return solid, False, "on the terrain it fails checks " + ", ".join(map(str, codes))
    return draped, is_cut, ""


def _told_again(told: tuple[dict[str, Any], ...], before: Solid, after: Solid) -> tuple[dict[str, Any], ...]:
    """Return what is told of a solid's faces for one whose ground, of which nothing is, comes first."""
    others = [one for one, kind in zip(told, before.semantics, strict=True) if kind != GROUND_SURFACE]
    return ({},) * (len(after.faces) - len(others)) + tuple(others) if before is not after else told


def _with_reason(model: BuildingModel, *remarks: str) -> BuildingModel:
    return replace(model, reason="; ".join(text for text in (model.reason, *remarks) if text))
