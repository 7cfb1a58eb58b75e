"""What the kinds of score share: their options, the area of interest, and the one reference system."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons

#: A result's building points, and a reference's unless told otherwise.
BUILDING = (int(PointClass.BUILDING),)


@dataclass(frozen=True)
class ScoreOptions:
    """
    What the kinds need to know beside their two sides.

    Attributes
    ----------
    area : MetricPolygons or None
        Only what lies inside counts.
    cell : float
        Side of a cell [m].
    fill : float
        How far an empty cell looks for its nearest point [spacings].
    reference_classes : collection of int or None
        The reference's classes of what is compared, None for the usual one.
    merge_touching : bool
        Whether outlines that share a wall are compared as one block.
    alpha : float or None
        Radius of the disc of the roofs' alpha shapes [m], None for one that follows the spacing.
    split_steps : bool
        Whether a step in height parts one roof from another.
    corner_tolerance : float
        How far a corner may lie from the one that it stands for [m].
    lod : str
        The finest level of detail of models that is looked at.
    """

    area: MetricPolygons | None
    cell: float
    fill: float
    reference_classes: Collection[int] | None
    merge_touching: bool = False
    alpha: float | None = None
    split_steps: bool = False
    corner_tolerance: float = 1.0
    lod: str = "2.2"


def is_inside(points: NDArray[np.float64], area: MetricPolygons | None) -> NDArray[np.bool_]:
    """Whether each point lies within the area of interest."""
    if area is None:
        return np.ones(len(points), dtype=bool)
    limits = shapely.union_all(area.polygons)
    shapely.prepare(limits)
    return np.asarray(shapely.intersects_xy(limits, points[:, 0], points[:, 1]), dtype=bool)


def check_same_system(result: str, reference: str, area: MetricPolygons | None) -> None:
    """Refuse sides in different reference systems; one that does not say its own is trusted."""
    named = [crs for crs in (result, reference, "" if area is None else area.crs) if crs.startswith("EPSG:")]
    if len(set(named)) > 1:
        raise InputError(
            f"the result, the reference and the area of interest are in {', '.join(dict.fromkeys(named))}: "
            "bring them to one reference system"
        )
