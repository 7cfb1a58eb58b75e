"""Versions of what results depend on."""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError, version

from lidar_buildings import __version__

_LIBRARIES = (
    "numpy", "scipy", "numba", "scikit-learn", "shapely", "laspy", "lazrs", "pyogrio", "pyproj",
    "rasterio", "mapbox-earcut",
)  # fmt: skip


def library_versions() -> dict[str, str]:
    """Return name → version of this package, of Python and of the libraries."""
    libraries = {name: _version(name) for name in _LIBRARIES}
    return {"lidar_buildings": __version__, "python": sys.version.split()[0], **libraries}


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "unknown"
