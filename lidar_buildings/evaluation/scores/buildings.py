"""How much of the buildings was found, cell by cell and point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lidar_buildings.evaluation.scores.cells import CellSet, cells_inside
from lidar_buildings.evaluation.scores.confusion import Confusion

#: Side of a cell: half a metre is what maps and eaves agree to [m].
DEFAULT_CELL = 0.5


@dataclass(frozen=True)
class BuildingScore:
    """
    Agreement of building areas in cells; a share of nothing is NaN.

    Attributes
    ----------
    cell : float
        Side of a cell [m].
    n_result_cells, n_reference_cells, n_common_cells : int
        Building cells of the result, of the reference, and of both.
    recall : float
        Common / reference (completeness).
    precision : float
        Common / result (correctness).
    iou : float
        Common / either (quality).
    """

    cell: float
    n_result_cells: int
    n_reference_cells: int
    n_common_cells: int
    recall: float
    precision: float
    iou: float


def score_buildings(
    result: CellSet, reference: CellSet, *, cell: float = DEFAULT_CELL, area: ArrayLike | None = None
) -> BuildingScore:
    """
    Compare the building cells of a result with those of a reference (Rutzinger et al. 2009, pixel-based).

    Parameters
    ----------
    result, reference : ndarray of int64
        Cells as `cells_of_polygons` and `cells_of_points` make them.
    cell : float
        Side of the cells [m].
    area : array_like of shapely.Polygon or MultiPolygon, optional
        Only cells with their centre inside count; everywhere if not given.

    Returns
    -------
    BuildingScore
    """
    if area is not None:
        result, reference = cells_inside(result, area, cell), cells_inside(reference, area, cell)
    n_common_cells = len(np.intersect1d(result, reference, assume_unique=True))
    agreement = Confusion(n_common_cells, len(result) - n_common_cells, len(reference) - n_common_cells, 0)
    return BuildingScore(
        cell=cell,
        n_result_cells=len(result),
        n_reference_cells=len(reference),
        n_common_cells=n_common_cells,
        recall=agreement.recall,
        precision=agreement.precision,
        iou=agreement.iou,
    )
