"""
The model of one building: heights, attributes and the LoD1.2 solid.

"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.building_model.config import ELEVATIONS, BuildingModelConfig
from lidar_buildings.core.building_model.result import BuildingModel, RoofFaces
from lidar_buildings.core.outline import Outline
from lidar_buildings.core.output_grid import gridded_outline, on_grid, repaired_outlines
from lidar_buildings.core.point_array import checked_column, checked_points
from lidar_buildings.core.point_spacing import measure_spacing
from lidar_buildings.core.roof_type import roof_type
from lidar_buildings.core.solid import ROOF_SURFACE, Solid, extrude
from lidar_buildings.core.status import BuildingStatus
from lidar_buildings.core.validity import check_solid

LOD = "1.2"
#: A spot of the outline is covered if a point lies within so many spacings.
_COVERAGE_RADIUS = 2.0
#: Most spots at which coverage is probed.
_MAX_PROBES = 20_000


def build_model(
    points: ArrayLike,
    outline: Outline,
    config: BuildingModelConfig | None = None,
    *,
    plane_id: ArrayLike | None = None,
    ground_elevation: float | None = None,
) -> BuildingModel:
    """
    Build a building's LoD1.2 model: its outline raised from the ground to the roof.

    The coordinates are rounded as they will be written before the solid is built, so that what is checked
    is what is written.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        The building's roof points, in any order [m].
    outline : Outline
        In the map frame [m].
    config : BuildingModelConfig, optional
    plane_id : array_like of shape (n_points,), optional
        Number of each point's roof plane, 0 = none.
    ground_elevation : float, optional
        Elevation of the ground at the building [m]; without it a height is assumed, and the reason says so.

    Returns
    -------
    BuildingModel

    Raises
    ------
    ValueError
        If an array has another shape, or a value is not finite.

    """
    config = config or BuildingModelConfig()
    points = checked_points(points)
    if plane_id is not None:
        plane_id = checked_column("plane_id", plane_id, len(points), np.uint16)
    if ground_elevation is not None and not math.isfinite(ground_elevation):
        raise ValueError(f"ground_elevation = {ground_elevation}: must be finite, or None if unknown")
    outline = gridded_outline(outline)
    attributes = _attributes(points, outline, plane_id)
    if not _has_extent(points):
        reason = f"{len(points)} roof points, too few or all on a line"
        return _without_solid(attributes, ground_elevation, BuildingStatus.DEGENERATE, reason)
    ground, remark = _ground(points, ground_elevation, config)
    roof = float(on_grid(np.percentile(points[:, 2], ELEVATIONS[config.roof_elevation])))
    if roof - ground < config.min_height:
        reason = f"the roof at {roof:.2f} m is not above the ground at {ground:.2f} m"
        return _without_solid(attributes, ground, BuildingStatus.NO_SOLID, reason)
    solid, codes, repair = _sound_solid(outline, ground, roof)
    attributes |= {
        "ground_elevation": ground,
        "height": float(on_grid(roof - ground)),
        "validity": str(list(codes)),
    }
    if codes:
        reason = "the solid fails checks " + ", ".join(map(str, codes))
        return _without_solid(attributes, ground, BuildingStatus.NO_SOLID, reason)
    attributes |= {"lod": LOD, "rmse": _rounded(np.sqrt(np.mean((points[:, 2] - roof) ** 2)))}
    reason = "; ".join(text for text in (remark, repair) if text)
    return BuildingModel({LOD: solid}, attributes, _roof_faces(solid), BuildingStatus.OK, reason)


def _attributes(
    points: NDArray[np.float64], outline: Outline, plane_id: NDArray[np.uint16] | None
) -> dict[str, Any]:
    """
    Return all attributes, those that need a solid still unknown.

    """
    spacing = measure_spacing(points) if len(points) > 1 else None
    elevations = {
        f"roof_elevation_{name}": float(on_grid(np.percentile(points[:, 2], share))) if len(points) else None
        for name, share in ELEVATIONS.items()
    }
    return {
        "ground_elevation": None,
        **elevations,
        "height": None,
        "area": _rounded(outline.area),
        "n_points": len(points),
        "point_spacing": None if spacing is None else _rounded(spacing),
        "n_planes": None if plane_id is None else len(np.unique(plane_id[plane_id > 0])),
        "roof_type": "unknown" if plane_id is None else roof_type(points, plane_id),
        "rmse": None,
        "coverage": None if spacing is None else _rounded(_coverage(points, outline, spacing)),
        "lod": "",
        "validity": "",
    }


def _without_solid(
    attributes: dict[str, Any], ground: float | None, status: BuildingStatus, reason: str
) -> BuildingModel:
    """
    Return the model of a building that gets none.

    """
    known = None if ground is None else float(on_grid(ground))
    return BuildingModel({}, attributes | {"ground_elevation": known}, (), status, reason)


def _ground(
    points: NDArray[np.float64], ground_elevation: float | None, config: BuildingModelConfig
) -> tuple[float, str]:
    """
    Return the elevation that the solid stands on, and what to remark about it.

    """
    if ground_elevation is not None:
        return float(on_grid(ground_elevation)), ""
    assumed = float(on_grid(points[:, 2].min() - config.assumed_height))
    return assumed, f"ground elevation unknown: taken {config.assumed_height:g} m below the lowest roof point"


def _sound_solid(outline: Outline, ground: float, roof: float) -> tuple[Solid, tuple[int, ...], str]:
    """
    Return a solid, the codes of what is wrong with it, and the repair that its outline took.

    Repairs are tried only where the outline as it is will not do; if none helps, the codes are those of
    the outline as it is.

    """
    solid = extrude(outline, ground, roof)
    codes = check_solid(solid)
    if codes:
        for repaired, what in repaired_outlines(outline):
            candidate = extrude(repaired, ground, roof)
            if not check_solid(candidate):
                return candidate, (), what
    return solid, codes, ""


def _has_extent(points: NDArray[np.float64]) -> bool:
    """
    Whether points span an area in plan.

    """
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1e-6 * spread[0])


def _coverage(points: NDArray[np.float64], outline: Outline, spacing: float) -> float:
    """
    Return the share of an outline's area that has a point near, from spots on a regular grid.

    """
    if len(outline.exterior) < 3 or outline.area <= 0:
        return 0.0
    low, high = outline.exterior.min(axis=0), outline.exterior.max(axis=0)
    step = max(spacing, math.sqrt(float(np.prod(high - low)) / _MAX_PROBES))
    x, y = (np.arange(a + 0.5 * min(step, b - a), b, step) for a, b in zip(low, high, strict=True))
    spots = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    polygon = shapely.Polygon(outline.exterior, outline.holes)
    shapely.prepare(polygon)
    inside = spots[shapely.contains_xy(polygon, spots)]
    if not len(inside):
        return 0.0
    distance = cKDTree(points[:, :2]).query(inside, distance_upper_bound=_COVERAGE_RADIUS * spacing)[0]
    return float(np.mean(np.isfinite(distance)))


def _roof_faces(solid: Solid) -> RoofFaces:
    """
    Return the rings of a solid's roof faces.

    """
    return tuple(
        solid.face_rings(face)
        for face, kind in zip(solid.faces, solid.semantics, strict=True)
        if kind == ROOF_SURFACE
    )


def _rounded(value: float) -> float:
    """
    Round what is measured to a tenth of a millimetre: sums may differ in their last digits with the order.

    """
    return round(float(value), 4)
