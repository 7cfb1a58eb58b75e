"""How wide the gaps between a roof's points are: scan lines far apart leave wider ones than numbers tell."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

#: Places on the roof that are asked how far their nearest point is, and the share that are nearer than gaps
#: are wide: a tenth may be wet patches and shafts.
_PLACES, _SHARE = 500, 0.9
#: That distance in even patterns is at most 0.7, where points lie anywhere in their cells [spacings].
_EVEN = 0.75
#: Wider gaps are no pattern of points [spacings].
_WIDEST = 2.0


def gap_spacing(positions: NDArray[np.float64], outline: shapely.Polygon, spacing: float) -> float:
    """
    Return the spacing that an even pattern with gaps as wide as a roof's has: up to twice the given one [m].

    How far it is from any place of the roof to the nearest point is the empty-space function of spatial
    statistics (Diggle, 1983, Statistical Analysis of Spatial Point Patterns). Turned and mirrored points have
    the same.
    """
    if outline.area == 0.0:
        return spacing
    middle = positions.mean(axis=0)
    corners = shapely.get_coordinates(outline) - middle
    dx, dy = (positions - middle).T
    # no scalar products: the threads that BLAS starts for long ones take more time than all else
    angle = 0.5 * np.arctan2(2.0 * (dx * dy).sum(), (dx * dx - dy * dy).sum())
    turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    width, height = np.abs(corners @ turned.T).max(axis=0)
    step = np.sqrt(outline.area / _PLACES)
    u, v = (step * np.arange(-(reach // step), reach // step + 1.0) for reach in (width, height))
    places = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2) @ turned + middle
    shapely.prepare(outline)
    places = places[shapely.contains_xy(outline, *places.T)]
    nearest = cKDTree(positions, balanced_tree=False, compact_nodes=False).query(places)[0]
    return float(np.clip(np.quantile(nearest, _SHARE) / _EVEN, spacing, _WIDEST * spacing))
