"""
Roof points that belong together: moving-window region growing.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.building_id import building_id
from lidar_buildings.core.parameters import StageConfig, parameter
from lidar_buildings.core.point_array import checked_column, checked_points
from lidar_buildings.core.point_order import cell_numbers
from lidar_buildings.core.point_spacing import given_or_measured
from lidar_buildings.core.segmentation.windows import chain_windows

#: Share of cells of the spacing's size that random points fill: 1 − 1/e.
_FILLED_SHARE = 0.632
#: Ids are drawn from 1 to this number.
_LARGEST_ID = 2**32 - 1


@dataclass(frozen=True)
class SegmentationConfig(StageConfig):
    """
    Settings of the moving-window region growing.

    """

    stage: ClassVar[str] = "segmentation"

    window: float = parameter(
        4.5,
        "Side of the moving window; raising it bridges wider gaps in a roof and joins closer neighbours.",
        unit="spacings",
        minimum=2.0,
        maximum=20.0,
    )
    min_points: int = parameter(
        10,
        "Fewest points of a building; raising it drops more of the small clusters.",
        minimum=1,
    )
    min_area: float = parameter(
        6.0,
        "Smallest area of a building, measured from its number of points; raising it drops more sheds.",
        unit="m²",
        minimum=0.0,
    )


@dataclass(frozen=True, eq=False)
class Segmentation:
    """
    Which building every point belongs to.

    Attributes
    ----------
    building_id : ndarray of uint32, shape (n_points,)
        0 = none.
    window : tuple of two float
        Sides of the window along x and y [m].

    """

    building_id: NDArray[np.uint32]
    window: tuple[float, float]


def segment_buildings(
    points: ArrayLike,
    config: SegmentationConfig | None = None,
    *,
    scan_angle: ArrayLike | None = None,
    gps_time: ArrayLike | None = None,
    point_spacing: float | None = None,
) -> Segmentation:
    """
    Gather the points of each building by moving-window region growing.

    A window is centred at a point, the points in it join, the window moves on to them, and so on until
    nothing is added (Sampath & Shan, 2007); the clusters are the connected components of points that lie in
    each other's windows, and are found as such. A cluster with too few points or too small an area is none.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        Roof points, in any order [m].
    config : SegmentationConfig, optional
        Settings.
    scan_angle, gps_time : array_like of shape (n_points,), optional
        Checked, and otherwise without influence: the window is a square with sides along x and y, sized by
        the spacing of all points together.
    point_spacing : float, optional
        Spacing of the pulses [m]; measured if not given.

    Returns
    -------
    Segmentation
        Ids are made from each cluster's westernmost point (`lidar_buildings.core.building_id`).

    Raises
    ------
    ValueError
        If an argument has the wrong shape or is not finite.

    Notes
    -----
    Near-linear in the number of points: about a second for a million, the measuring of the spacing included.

    """
    config = config or SegmentationConfig()
    cloud = checked_points(points)
    for name, column in (("scan_angle", scan_angle), ("gps_time", gps_time)):
        if column is not None:
            checked_column(name, column, len(cloud), np.float64)
    spacing = given_or_measured(cloud, point_spacing)
    window = config.window * spacing
    component, n_components = chain_windows(cloud[:, :2], (window / 2, window / 2))
    n_points = np.bincount(component, minlength=n_components)
    is_building = (n_points >= config.min_points) & (
        occupied_area(cloud[:, :2], component, n_components, spacing) >= config.min_area
    )
    anchors = cloud[_anchor_rows(cloud, component)]
    ids = np.zeros(n_components, dtype=np.uint32)
    ids[is_building] = distinct_ids(anchors[is_building])
    return Segmentation(ids[component], (window, window))


def occupied_area(
    xy: NDArray[np.float64], component: NDArray[np.int64], n_components: int, spacing: float
) -> NDArray[np.float64]:
    """
    Return the area [m²] of every component: its occupied square metres, as far as points can tell.

    Points that fall into one cell of the spacing's size count once, so that overlapping strips do not add to
    the area; a cell that random points leave empty is made up for by the share of cells that they fill.

    """
    # Points of one cell lie in each other's windows: a cell belongs to one component.
    _, first = np.unique(cell_numbers(xy, spacing), return_index=True)
    n_cells = np.bincount(component[first], minlength=n_components).astype(np.float64)
    return n_cells * (spacing**2 / _FILLED_SHARE)


def distinct_ids(anchors: NDArray[np.float64]) -> NDArray[np.uint32]:
    """
    Return one id per anchor, all different.

    Where two anchors share a cell, and so an id, the western one keeps it and the other takes the next free.

    Parameters
    ----------
    anchors : ndarray of shape (n_buildings, 3)
        In any order [m].

    """
    wanted = [building_id(anchor) for anchor in anchors]
    order = np.lexsort((anchors[:, 2], anchors[:, 1], anchors[:, 0]))
    ids = np.zeros(len(anchors), dtype=np.uint32)
    taken = set(wanted)
    given: set[int] = set()
    for row in order:
        number = wanted[row]
        if number in given:
            while number in taken:
                number = number % _LARGEST_ID + 1
            taken.add(number)
        given.add(number)
        ids[row] = number
    return ids


def _anchor_rows(cloud: NDArray[np.float64], component: NDArray[np.int64]) -> NDArray[np.intp]:
    """
    Return the row of every component's anchor: its westernmost point, ties broken by y, then z.

    """
    order = np.lexsort((cloud[:, 0], component))
    _, first = np.unique(component[order], return_index=True)
    west = cloud[order[first], 0]
    tied = np.flatnonzero(cloud[:, 0] == west[component]) if len(cloud) else np.zeros(0, dtype=np.intp)
    tied = tied[np.lexsort((cloud[tied, 2], cloud[tied, 1], component[tied]))]
    _, first = np.unique(component[tied], return_index=True)
    return tied[first]
