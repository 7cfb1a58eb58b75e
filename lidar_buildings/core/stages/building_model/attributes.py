"""The attributes of a building's model, see doc/formats.md."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.output_grid import elevation_on_grid
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.stages.building_model.config import ELEVATIONS
from lidar_buildings.core.stages.building_model.quality import ModelQuality
from lidar_buildings.core.stages.building_model.result import ATTRIBUTES
from lidar_buildings.core.stages.roof_topology.result import RoofTopology
from lidar_buildings.core.surfaces.percentiles import percentile_of


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
        "validity": "",
    }


def elevation_at(z: FloatArray, share: float) -> float:
    """Return a percentile of rising elevations on the output grid [m]."""
    return elevation_on_grid(percentile_of(z, share / 100.0))


def solid_attributes(lod: str, solid: Solid) -> dict[str, Any]:
    """Return what the finest solid, a valid one, tells by itself."""
    return {"volume": _rounded(solid.volume), "lod": lod, "validity": "[]"}


def roof_attributes(topology: RoofTopology, quality: ModelQuality) -> dict[str, Any]:
    """Return what the roof's planes and the agreement with the points tell."""
    return {
        "roof_type": topology.roof_type,
        "rmse": None if quality.rmse is None else _rounded(quality.rmse),
        "coverage": _rounded(quality.coverage),
        "no_data_share": _rounded(quality.no_data_share),
        "plane_sigma": _plane_sigma(topology),
    }


def _plane_sigma(topology: RoofTopology) -> float | None:
    """Return the root mean square distance of all planes' points to their planes [m]."""
    n = sum(plane.n_points for plane in topology.planes)
    if not n:
        return None
    return _rounded(math.sqrt(sum(plane.n_points * plane.rms**2 for plane in topology.planes) / n))


def _rounded(value: float) -> float:
    """Round to a tenth of a millimetre: sums may differ in their last digits with the order."""
    return round(float(value), 4)
