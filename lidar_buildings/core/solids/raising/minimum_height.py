"""Roofs that would come down to the ground or below it, cut off at a least height."""

from __future__ import annotations

from collections.abc import Sequence

from lidar_buildings.core.solids.raising.level_cut import cut_at
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece

#: Least height of a roof above the ground [m].
MIN_HEIGHT = 0.1
#: Pieces that are too low by less than this keep their planes: their columns are lifted [m].
_TOLERATED = 0.004


def with_minimum_height(pieces: Sequence[RoofPiece], ground_elevation: float) -> list[RoofPiece]:
    """Return the pieces, with what lies lower than `MIN_HEIGHT` above the ground replaced by flat pieces."""
    floor = ground_elevation + MIN_HEIGHT
    return [part for piece in pieces for part in _part_above(piece, floor)]


def _part_above(piece: RoofPiece, floor: float) -> list[RoofPiece]:
    """Return a piece itself, or what of it lies above a floor and the flat rest."""
    if not piece.rings or not len(piece.rings[0]):
        return []
    a, b, c = piece.plane
    elevations = piece.rings[0] @ (a, b) + c
    if elevations.min() >= floor - _TOLERATED:
        return [piece]
    flat = (0.0, 0.0, floor)
    if elevations.max() <= floor + _TOLERATED or not (a or b):
        return [RoofPiece(piece.rings, flat)]
    upper, lower = cut_at(piece.rings, piece.plane, floor)
    return [*(RoofPiece(rings, piece.plane) for rings in upper), *(RoofPiece(rings, flat) for rings in lower)]
