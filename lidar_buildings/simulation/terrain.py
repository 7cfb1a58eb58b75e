"""Analytic terrain: a slope and a few waves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel


@dataclass(frozen=True)
class Wave:
    """One sine wave of the terrain."""

    #: [m].
    amplitude: float
    wavelength: float
    direction_deg: float = 0.0  #: direction in which it runs, counter-clockwise from x
    phase: float = 0.0  #: [rad]


@dataclass(frozen=True)
class Terrain:
    """Ground whose elevation is known everywhere."""

    elevation: float = 0.0  #: at the origin, without the waves [m]
    slope: tuple[float, float] = (0.0, 0.0)  #: rise per metre along x and y
    waves: tuple[Wave, ...] = ()  #: what is added to the slope

    def coefficients(self) -> NDArray[np.float64]:
        """Return (elevation, slope x, slope y, 0), then amplitude, wave numbers x and y, phase per wave."""
        rows = [(self.elevation, *self.slope, 0.0)]
        for wave in self.waves:
            number, direction = 2 * np.pi / wave.wavelength, np.deg2rad(wave.direction_deg)
            rows.append((wave.amplitude, number * np.cos(direction), number * np.sin(direction), wave.phase))
        return np.array(rows)

    def at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Elevation [m] at positions of shape (n, 2)."""
        return _elevations(np.ascontiguousarray(xy, dtype=np.float64), self.coefficients())


@kernel
def terrain_elevation(x, y, coefficients):
    """Elevation at one position [m]; `coefficients` as `Terrain.coefficients` gives them."""
    z = coefficients[0, 0] + coefficients[0, 1] * x + coefficients[0, 2] * y
    for row in range(1, len(coefficients)):
        angle = coefficients[row, 1] * x + coefficients[row, 2] * y + coefficients[row, 3]
        z += coefficients[row, 0] * np.sin(angle)
    return z


@kernel
def _elevations(xy, coefficients):
    """Elevation at many positions [m]."""
    z = np.empty(len(xy))
    for row in range(len(xy)):
        z[row] = terrain_elevation(xy[row, 0], xy[row, 1], coefficients)
    return z
