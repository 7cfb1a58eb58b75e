"""What a score is asked for, and where and in which system its two sides are compared."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.evaluation.scores.polygons import within

if TYPE_CHECKING:  # imported late: --help answers at once
    from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons

#: The levels of detail of models.
LODS = ("1.2", "1.3", "2.2")
#: Option → its least and greatest value, from the precision of points and maps to the size of buildings.
_RANGES = {
    "cell": (0.05, 100.0),
    "fill": (0.0, 10.0),
    "alpha": (0.01, 100.0),
    "corner_tolerance": (0.01, 100.0),
}
#: A result's building points, and a reference's unless told otherwise.
BUILDING = (int(PointClass.BUILDING),)


@dataclass(frozen=True)
class ScoreOptions:
    """
    The options of all kinds of score.

    ParameterError if a number is out of range or the level is unknown.
    """

    area: MetricPolygons | None = None  #: the area of interest: only what lies inside counts
    cell: float = 0.5  #: side of the cells in which buildings are compared [m]
    #: How far an empty cell looks for its nearest point [spacings]; see `evaluation.scores.cells`.
    fill: float = 1.5
    #: The reference's classes of ground (default 2) or of buildings and roofs (default 6).
    reference_classes: Collection[int] | None = None
    #: Whether outlines that share a wall are compared as one block; see `evaluation.scores.blocks`.
    merge_touching: bool = False
    #: Radius of the disc that finds the reference's edges [m]; 1.342 point spacings if None.
    alpha: float | None = None
    #: Whether a step in height parts one roof of the reference from another, and so is an edge.
    split_steps: bool = False
    #: How far a corner of an outline or of a roof may lie from the one that it stands for [m].
    corner_tolerance: float = 1.0
    lod: str = LODS[-1]  #: the finest level of detail that is looked at: ``"1.2"``, ``"1.3"`` or ``"2.2"``

    def __post_init__(self) -> None:
        for name, (least, greatest) in _RANGES.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= greatest:
                option = name.replace("_", "-")
                raise ParameterError(f"score --{option} {value:g}: must be within {least:g} to {greatest:g}")
        if self.lod not in LODS:
            raise ParameterError(f"score --lod {self.lod}: must be one of {', '.join(LODS)}")


def is_inside(points: NDArray[np.float64], area: MetricPolygons | None) -> NDArray[np.bool_]:
    """Whether each point lies within the area of interest."""
    return within(points, None if area is None else shapely.union_all(area.polygons))


def check_same_system(result: str, reference: str, area: MetricPolygons | None) -> None:
    """Refuse sides in different reference systems; one that does not say its own is trusted."""
    named = [crs for crs in (result, reference, "" if area is None else area.crs) if crs.startswith("EPSG:")]
    if len(set(named)) > 1:
        raise InputError(
            f"the result, the reference and the area of interest are in {', '.join(dict.fromkeys(named))}: "
            "bring them to one reference system"
        )
