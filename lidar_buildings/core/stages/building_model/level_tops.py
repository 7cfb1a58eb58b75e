"""Roof faces that rise above everything that was seen, cut off level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.solids.raising.level_cut import cut_at
from lidar_buildings.core.stages.building_model.cell_costs import ABOVE
from lidar_buildings.core.stages.building_model.result import RoofFacePatch


def with_level_tops(faces: list[RoofFacePatch], points: FloatArray, spacing: float) -> list[RoofFacePatch]:
    """
    Cut off what rises above all points, as where a whole slope of a roof has none.

    A plane is good where its points are, and for a spacing beyond. There the roof is level, at the height of
    the highest return.
    """
    planes, exteriors = np.array([face.plane for face in faces]), [face.rings[0] for face in faces]
    sizes = np.array([len(ring) for ring in exteriors])
    xy, own = np.concatenate(exteriors), np.repeat(planes, sizes, axis=0)
    highest = np.maximum.reduceat(np.einsum("ij,ij->i", own[:, :2], xy) + own[:, 2], np.cumsum(sizes) - sizes)
    tops = points[:, 2].max() + ABOVE + spacing * np.hypot(planes[:, 0], planes[:, 1])
    return [
        piece
        for face, high, top in zip(faces, highest.tolist(), tops.tolist(), strict=True)
        for piece in ([face] if high <= top else _cut_off(face, top))
    ]


def _cut_off(face: RoofFacePatch, top: float) -> list[RoofFacePatch]:
    """Return the pieces of a face below an elevation, the first with its points, and level ones."""
    above, below = cut_at(face.rings, face.plane, top)
    level, none = np.array([0.0, 0.0, top]), face.rows[:0]
    return [
        *(replace(face, rings=rings, rows=none if k else face.rows) for k, rings in enumerate(below)),
        *(replace(face, rings=rings, plane=level, rows=none) for rings in above),
    ]
