"""Geometries from one coordinate reference system to another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray
from pyproj.exceptions import CRSError, ProjError

from lidar_buildings.core.model.errors import InputError


def to_system(geometries: NDArray[Any], source: str, target: str, label: str) -> NDArray[Any]:
    """
    Transform geometries in the plane; x stands before y, longitude before latitude, whatever the systems say.

    Vertices outside the area that the systems know become infinite.

    Parameters
    ----------
    geometries : ndarray of shapely geometries
    source, target : str
        EPSG codes or WKT texts.
    label : str
        The file, for the error.

    Raises
    ------
    InputError
        If there is no way from one system to the other.
    """
    try:
        one, other = _horizontal(source), _horizontal(target)
        if one == other:
            return geometries
        transformer = pyproj.Transformer.from_crs(one, other, always_xy=True)
    except (CRSError, ProjError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"{label}: cannot be transformed from {source[:40]} to {target[:40]} ({reason}): "
            "transform the file before"
        ) from error

    def moved(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(transformer.transform(xy[:, 0], xy[:, 1]))

    return shapely.transform(geometries, moved)


def is_in_degrees(crs: str) -> bool:
    """Whether a reference system is known to have longitude and latitude."""
    try:
        return bool(crs) and bool(_horizontal(crs).is_geographic)
    except CRSError:
        return False


def _horizontal(text: str) -> Any:
    """Return the horizontal part of a reference system."""
    crs = pyproj.CRS.from_user_input(text)
    crs = crs.source_crs if crs.is_bound else crs
    part = crs.sub_crs_list[0] if crs.sub_crs_list else crs
    return part.source_crs if part.is_bound else part
