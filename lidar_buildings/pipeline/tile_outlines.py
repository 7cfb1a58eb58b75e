"""A tile's outlines made regular, touching buildings with common walls."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import shapely

from lidar_buildings.core.model.outline import BuildingOutline, Outline, OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.solids.output_grid import made_valid
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.regularisation.regularising import (
    RegularisedOutline,
    outline_quality,
    regularise_outline,
)
from lidar_buildings.core.stages.regularisation.samples import ring_spacing, working_spacing
from lidar_buildings.core.stages.regularisation.shared_walls import MAX_CHANGE, share_walls
from lidar_buildings.pipeline.building_pool import BuildingPool, map_buildings

_log = logging.getLogger(__name__)

#: Buildings whose traced rings come so near to each other were one block: different blocks are
#: farther apart, by half the window of the segmentation, 2.25 spacings [spacings].
_TOUCHING = 1.75
#: What rounding may leave of an overlap of buildings that share a wall [m²].
_MAX_OVERLAP = 1e-2


def regularise_outlines(
    outlines: tuple[BuildingOutline, ...], config: RegularisationConfig, pool: BuildingPool | None = None
) -> tuple[BuildingOutline, ...]:
    """
    Regularise every traced outline, and let touching ones share walls; one that cannot be keeps its rings.

    All come back with their quality. With `keep_outlines` their rings stay as they are, given footprints for
    instance.

    What becomes of an outline depends on those of its own block alone, which is never cut by a tile's edge.
    Each is regularised by itself first, in the pool's processes if there is one.
    """
    if config.keep_outlines:
        given = OutlineQuality(0.0, 0.0, BuildingStatus.OK, "")
        return tuple(replace(one, quality=given) for one in outlines)
    traced = [one.outline for one in outlines]
    sizes = [sum(map(len, one.rings)) for one in traced]
    jobs = [(one.building_id, partial(regularise_outline, one.outline, config)) for one in outlines]

    def kept(k: int, reason: str) -> RegularisedOutline:
        return RegularisedOutline(traced[k], np.nan, np.nan, (), BuildingStatus.FAILED, reason)

    own = map_buildings(pool, jobs, sizes, kept, "regularisation failed, the traced ring is kept")
    regular = [one.outline for one in own]
    groups = touching_groups(traced)
    if config.max_wall_gap:
        for members in groups:
            _share_walls(regular, traced, members, config)
    regular = [_sound(outline.as_carried(), ring) for outline, ring in zip(regular, traced, strict=True)]
    for members in groups:
        _part(regular, traced, members)
    finished = []
    for one, outline, alone in zip(outlines, regular, own, strict=True):
        quality = OutlineQuality(alone.sigma, alone.max_offset, alone.status, alone.reason, alone.bias)
        if alone.status is not BuildingStatus.FAILED:
            quality = outline_quality(one.outline, outline, alone, config)
        finished.append(replace(one, outline=outline, quality=quality))
    return tuple(finished)


def touching_groups(traced: Sequence[Outline]) -> list[list[int]]:
    """Return the rows of buildings whose traced rings were split from one block, group by group."""
    known = [row for row, outline in enumerate(traced) if len(outline.exterior) >= 3]
    if len(known) < 2:
        return []
    rings = np.array([Outline(traced[row].exterior).polygon for row in known], dtype=object)
    reach = _TOUCHING * np.array([ring_spacing(traced[row]) for row in known])
    one, other = shapely.STRtree(rings).query(rings, predicate="dwithin", distance=reach)
    near = shapely.distance(rings[one], rings[other]) <= 0.5 * (reach[one] + reach[other])
    group = sets_of_pairs(len(known), one[near], other[near])
    return [
        [known[k] for k in np.flatnonzero(group == number)]
        for number in np.flatnonzero(np.bincount(group) > 1)
    ]


def _share_walls(
    outlines: list[Outline], traced: list[Outline], members: list[int], config: RegularisationConfig
) -> None:
    """Let the buildings of one block share their walls, in place; where that fails they keep their own."""
    try:
        shared = share_walls(
            [outlines[row] for row in members],
            [traced[row] for row in members],
            [config.max_wall_gap * working_spacing(traced[row], config) for row in members],
        )
    except Exception:
        x, y = outlines[members[0]].exterior[0]
        _log.exception("block at (%.1f, %.1f): its %d buildings share no walls", x, y, len(members))
        return
    for row, outline, reason in zip(members, shared.outlines, shared.reasons, strict=True):
        if reason:
            _log.info("building at (%.1f, %.1f): %s", *outlines[row].exterior[0], reason)
        outlines[row] = outline


def _sound(outline: Outline, traced: Outline) -> Outline:
    """Return an outline that rounding has left valid and without repeated vertices, else the traced one."""
    repeats = any((ring == np.roll(ring, -1, axis=0)).all(axis=1).any() for ring in outline.rings)
    if repeats or (len(outline.exterior) >= 3 and not outline.polygon.is_valid):
        return traced
    return outline


def _part(outlines: list[Outline], traced: list[Outline], members: list[int]) -> None:
    """
    Part the outlines of a block where they overlap, in place.

    The one whose traced ring holds less of the overlap loses it; where that would change it too much, both
    get back their traced outlines, the smaller one first.
    """
    # rings that messages bring may cross themselves
    polygons = made_valid(np.array([outlines[row].polygon for row in members], dtype=object))
    before = made_valid(np.array([traced[row].polygon for row in members], dtype=object))
    pairs = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    for one, other in sorted(pairs[:, pairs[0] < pairs[1]].T.tolist()):
        overlap = polygons[one].intersection(polygons[other])
        if overlap.area <= _MAX_OVERLAP:
            continue
        held = {k: before[k].intersection(overlap).area for k in (one, other)}
        loser = min(held, key=lambda k: (held[k], traced[members[k]].area, k))
        rest = shapely.difference(polygons[loser], polygons[one + other - loser])
        if rest.geom_type == "Polygon" and rest.area >= (1.0 - MAX_CHANGE) * polygons[loser].area:
            cut = Outline.of(rest).as_carried()
            if _sound(cut, traced[members[loser]]) is cut:
                outlines[members[loser]], polygons[loser] = cut, cut.polygon
        for k in sorted((one, other), key=lambda k: (traced[members[k]].area, k)):
            if polygons[one].intersection(polygons[other]).area <= _MAX_OVERLAP:
                break
            outlines[members[k]] = traced[members[k]]
            polygons[k] = before[k]
