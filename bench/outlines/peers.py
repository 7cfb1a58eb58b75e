"""
Libraries that make outlines, on the clusters that this package's segmentation found.

A peer is taken in if `pip` installs it from a wheel on Linux with Python 3.11 and its licence is permissive.
Looked at, with what came of it:

==================  ======  ==============================================================================
package             licence verdict
==================  ======  ==============================================================================
shapely             BSD-3   taken: ``concave_hull`` with ratio 0.05, without holes; plain, and simplified by
                            half a metre (Douglas & Peucker)
buildingregulariser MIT     taken: turns the edges of polygons into main directions, their normals and
                            diagonals, and finds circles; its defaults, in one process; on the plain hulls
alphashape          MIT     left out: seconds per building
==================  ======  ==============================================================================
"""

from __future__ import annotations

import importlib.util
import time
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

#: Length of a hull's longest edge as a share of the way from the shortest to the longest possible one.
HULL_RATIO = 0.05
#: What a simplified hull may deviate by: the default of buildingregulariser [m].
SIMPLIFY = 0.5
#: Name → package that has to be importable.
PEERS = {
    "concave_hull": "shapely",
    "concave_hull_simplified": "shapely",
    "buildingregulariser": "buildingregulariser",
}


class PeerResult(NamedTuple):
    """What a peer made of clusters."""

    polygons: NDArray[Any]  #: one per cluster; empty where nothing came out. Shapely geometries.
    seconds: float  #: wall time, hulls included


def is_installed(name: str) -> bool:
    """Whether a peer's package is there."""
    return importlib.util.find_spec(PEERS[name]) is not None


def run_peer(name: str, clusters: Sequence[NDArray[np.float64]]) -> PeerResult:
    """Make outlines from clusters of points, array of shape (n_points, 2) or more columns each."""
    start = time.perf_counter()
    hulls = shapely.concave_hull(
        [shapely.multipoints(points[:, :2]) for points in clusters], ratio=HULL_RATIO, allow_holes=False
    )
    if name == "concave_hull_simplified":
        hulls = shapely.simplify(hulls, SIMPLIFY)
    elif name == "buildingregulariser":
        hulls = _regularised(hulls)
    seconds = time.perf_counter() - start
    return PeerResult(np.asarray(hulls, dtype=object), seconds)


def _regularised(hulls: NDArray[Any]) -> NDArray[Any]:
    """Let buildingregulariser turn hulls into regular outlines."""
    import geopandas
    from buildingregulariser import regularize_geodataframe

    frame = geopandas.GeoDataFrame({"row": np.arange(len(hulls))}, geometry=list(hulls))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = regularize_geodataframe(frame, num_cores=1)
    regular = np.full(len(hulls), shapely.Polygon(), dtype=object)
    regular[found["row"].to_numpy()] = found.geometry.to_numpy()
    return regular
