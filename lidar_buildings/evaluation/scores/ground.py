"""The errors of a ground filter, point by point."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.evaluation.scores.statistics import confusion_of, ratio

#: A result's ground: roads and rails lie on it, and water kept from the source is part of its surface.
RESULT_GROUND = (
    int(PointClass.GROUND),
    int(PointClass.WATER),
    int(PointClass.RAIL),
    int(PointClass.ROAD_SURFACE),
)
#: A reference's ground, unless it keeps water or roads in classes of their own.
REFERENCE_GROUND = (int(PointClass.GROUND),)


@dataclass(frozen=True)
class GroundScore:
    """The errors as Sithole and Vosselman (2004) define them; a share of nothing is NaN."""

    #: Points of the reference.
    n_points: int
    n_ground: int
    n_object: int
    #: Ground taken for object, and object taken for ground.
    n_ground_rejected: int
    n_object_accepted: int
    type_1_error: float  #: ground rejected / ground
    type_2_error: float  #: object accepted / object
    total_error: float  #: both errors / points
    kappa: float  #: Cohen's kappa


def score_ground(
    result: ArrayLike,
    reference: ArrayLike,
    *,
    result_ground: Collection[int] = RESULT_GROUND,
    reference_ground: Collection[int] = REFERENCE_GROUND,
) -> GroundScore:
    """
    Compare two classifications of the same points: ground, or object (everything else).

    Give 2, 9, 11 as ground where the reference has water and roads apart. ValueError if the lengths differ.
    """
    agreement = confusion_of(
        np.isin(np.asarray(result), list(result_ground)),
        np.isin(np.asarray(reference), list(reference_ground)),
    )
    n_ground = agreement.hits + agreement.misses
    n_object = agreement.total - n_ground
    return GroundScore(
        n_points=agreement.total,
        n_ground=n_ground,
        n_object=n_object,
        n_ground_rejected=agreement.misses,
        n_object_accepted=agreement.false_alarms,
        type_1_error=ratio(agreement.misses, n_ground),
        type_2_error=ratio(agreement.false_alarms, n_object),
        total_error=ratio(agreement.misses + agreement.false_alarms, agreement.total),
        kappa=agreement.kappa,
    )
