"""The local map frame: where it lies in the source's coordinate reference system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MapFrame:
    """Ties the metric, local `map` frame to the source's coordinates."""

    crs: str = ""  #: ``"EPSG:28992"``, a WKT text where no code is known, or empty
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: what to add to map coordinates [m]
    #: Metres per unit of the source's x and y, and of its z (0.3048 for feet).
    horizontal_unit: float = 1.0
    vertical_unit: float = 1.0

    @property
    def units(self) -> NDArray[np.float64]:
        """Metres per source unit, per axis."""
        return np.array([self.horizontal_unit, self.horizontal_unit, self.vertical_unit])

    def to_map(self, source_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn source coordinates, shape (n, 3), into map coordinates [m]."""
        return np.asarray(source_xyz, dtype=np.float64) * self.units - np.asarray(self.origin)

    def to_source(self, map_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn map coordinates [m], shape (n, 3), into source coordinates."""
        return (np.asarray(map_xyz, dtype=np.float64) + np.asarray(self.origin)) / self.units
