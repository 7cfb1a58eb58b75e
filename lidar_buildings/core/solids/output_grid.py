"""The grid on which coordinates are written, and outlines that are sound once rounded to it."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.outline import Outline

#: Written coordinates are whole multiples of this [m].
GRID = 0.001
#: How far an outline whose rings touch is drawn in, so that a solid can stand on it [m].
_INSET = 0.01
#: Share of its area that an outline may lose by repair.
_MAX_LOSS = 0.05


def on_grid(coordinates: ArrayLike) -> FloatArray:
    """Round coordinates [m] to the grid."""
    # Dividing by 1000 gives the double nearest to the decimal number; multiplying by 0.001 does not.
    return np.rint(np.asarray(coordinates, dtype=np.float64) / GRID) / round(1 / GRID)


def elevation_on_grid(elevation: float) -> float:
    """Round one elevation or height [m] to the grid, as `on_grid`."""
    return round(elevation / GRID) / round(1 / GRID)


def gridded_outline(outline: Outline) -> Outline:
    """Round an outline to the grid, leaving out repeated vertices, spikes and holes without area."""
    exterior, *holes = (_without_repetitions(on_grid(ring)) for ring in outline.rings)
    return Outline(exterior, tuple(hole for hole in holes if len(hole) >= 3)).oriented()


def repaired_outlines(outline: Outline) -> list[tuple[Outline, str]]:
    """
    Return (outline, what was done) for the repairs to try, the gentlest first.

    Crossing rings are cut apart and the largest part is kept; rings that touch are drawn in by a centimetre.
    """
    parts = shapely.make_valid(outline.polygon)
    sound = _largest(parts)
    drawn_in = _largest(sound.buffer(-_INSET, join_style="mitre"))
    candidates = [
        (sound, "crossing rings were cut apart"),
        (drawn_in, "touching rings were drawn in by 1 cm"),
    ]
    return [
        (gridded_outline(Outline.of(candidate)), what)
        for candidate, what in candidates
        if not candidate.is_empty and candidate.area >= (1.0 - _MAX_LOSS) * parts.area
    ]


def _without_repetitions(ring: FloatArray) -> FloatArray:
    """Leave out vertices equal to the next one, and tips of spikes, until there are none."""
    corners = list(map(tuple, ring.tolist()))
    while len(corners) >= 3:
        after = corners[1:] + corners[:1]
        kept = [one for one, other in zip(corners, after, strict=True) if one != other]
        if len(kept) == len(corners):
            # One tip at a time: its neighbours become a repetition.
            tips = (k for k, other in enumerate(after) if corners[k - 1] == other)
            tip = next(tips, None)
            if tip is None:
                break
            del kept[tip]
        corners = kept
    return ring if len(corners) == len(ring) else np.array(corners).reshape(-1, 2)


def made_valid(polygons: NDArray[np.object_]) -> NDArray[np.object_]:
    """
    Return polygons with those that are not valid repaired by structure: exteriors less their holes.

    As GEOS' `make_valid` by structure, which shapely has from 2.1 on.
    """
    repaired = polygons.copy()
    for k in np.flatnonzero(~shapely.is_valid(polygons)):
        inside, *holes = (
            shapely.union_all(polygons_of(shapely.make_valid(shapely.Polygon(ring))))
            for ring in (polygons[k].exterior, *polygons[k].interiors)
        )
        repaired[k] = shapely.difference(inside, shapely.union_all(holes))
    return repaired


def polygons_of(geometry: shapely.Geometry) -> list[shapely.Polygon]:
    """Return all polygons of any geometry."""
    parts = [part for part in shapely.get_parts(geometry) if part.geom_type in ("Polygon", "MultiPolygon")]
    return [polygon for part in parts for polygon in shapely.get_parts(part)]


def _largest(geometry: shapely.Geometry) -> shapely.Polygon:
    return max(
        polygons_of(geometry), key=lambda polygon: (polygon.area, polygon.wkb), default=shapely.Polygon()
    )
