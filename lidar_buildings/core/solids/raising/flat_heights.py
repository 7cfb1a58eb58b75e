"""Flat pieces of almost the same elevation, given the same one: edges that they share stay level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lidar_buildings.core.solids.raising.half_edges import MERGE_TOLERANCE
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece


def align_flat_heights(pieces: Sequence[RoofPiece]) -> list[RoofPiece]:
    """
    Return the pieces, the flat ones within `MERGE_TOLERANCE` of each other at the middle of their elevations.

    Otherwise elevations would be merged at common vertices only, and flat roofs slope by millimetres.
    """
    flat = {piece.plane[2] for piece in pieces if piece.plane[0] == piece.plane[1] == 0.0}
    common: dict[float, float] = {}
    group: list[float] = []
    for elevation in [*sorted(flat), float("inf")]:
        if group and elevation - group[0] > MERGE_TOLERANCE:
            common |= dict.fromkeys(group, 0.5 * (group[0] + group[-1]))
            group = []
        group.append(elevation)
    return [_at(piece, common.get(piece.plane[2])) for piece in pieces]


def _at(piece: RoofPiece, elevation: float | None) -> RoofPiece:
    """Return a flat piece at another elevation, others as they are."""
    if elevation is None or piece.plane[0] or piece.plane[1] or elevation == piece.plane[2]:
        return piece
    return replace(piece, plane=(0.0, 0.0, elevation))
