"""The measures that points are clustered by, and centres that are typical of roofs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.surfaces.eigenfeatures import EigenFeatures

#: Feature set → centres of surfaces and of edges where a roof's own are not to be had: means over the roofs
#: of four areas, of 2 to 26 points/m², at the default radii.
TYPICAL_CENTRES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "eigenvalues": ((0.26, 0.23, 0.005), (0.225, 0.10, 0.01)),
    "linearity_planarity": ((0.11, 0.87), (0.59, 0.36)),
    "linearity": ((0.11,), (0.60,)),
}


def eigenvalues_by_area(found: EigenFeatures) -> NDArray[np.float64]:
    """Return λ in units of the neighbourhood's R², which makes them comparable from radius to radius."""
    return found.eigenvalues / np.square(found.radius)[:, None]


def measures_of(found: EigenFeatures, features: str) -> NDArray[np.float64]:
    """
    Return what points are clustered by, shape (n_points, n_features), within 0 to 1.

    `features` is the feature set (Santos and others, Table 2).
    """
    if features == "eigenvalues":
        return eigenvalues_by_area(found)
    return np.column_stack([getattr(found, name) for name in features.split("_")])
