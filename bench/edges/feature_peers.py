"""
The libraries whose features are compared, each in two steps: the search for neighbours, and the features.

A peer is taken in if `pip` installs it from a wheel on Linux with Python 3.11, its licence is permissive and
it describes spherical neighbourhoods of points. Looked at, with what came of it:

============  =========  ====================================================================================
package       licence    verdict
============  =========  ====================================================================================
jakteristics  BSD-2      taken: all features of a fixed radius, float64 but for the results and the radius
pgeof         MIT        taken: a fixed radius in float64 (``selected``) and in float32 with its own search;
                         ``optimal``, the eigenentropy's choice among numbers of neighbours, float32
open3d        MIT        taken: covariances and normals of a fixed radius, float64; no features
pdal          BSD        left out: source only, it needs the PDAL library installed beforehand
============  =========  ====================================================================================
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.labelling import MIN_RADIUS, label_edges
from lidar_buildings.core.surfaces.eigenfeatures import EigenFeatures, eigen_features

# Threads that wait in a loop for one another slow down whatever is measured next.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

#: Points that a radius has to hold to be chosen, and the fewest that pgeof looks at.
MIN_NEIGHBOURS = 9


class Task(NamedTuple):
    """What is to be described."""

    #: Near the origin, so that float32 is enough for the peers that need it [m], shape (n_points, 3).
    points: NDArray[np.float64]
    radii: NDArray[np.float64]  #: rising; a single one fixes the radius [m]. Shape (n_radii,).
    most: int  #: the largest number of neighbours within the largest radius, which pgeof has to be told


class Library(NamedTuple):
    """A way to describe neighbourhoods."""

    package: str  #: what has to be importable
    #: Task → neighbours; None where it cannot be told apart from what follows.
    search: Callable[[Task], Any] | None
    describe: Callable[[Task, Any], Any]  #: task and what `search` returned → features

    @property
    def installed(self) -> bool:
        """Whether the package is there."""
        return importlib.util.find_spec(self.package) is not None


def task_of(points: NDArray[np.float64], radii: Sequence[float]) -> Task:
    """Count the neighbours that there are at most."""
    widest = eigen_features(points, [radii[-1]])
    return Task(points, np.asarray(radii), int(widest.n_neighbours.max(initial=1)))


def own_features(task: Task) -> EigenFeatures:
    """Run this package."""
    return eigen_features(task.points, list(task.radii), min_neighbours=MIN_NEIGHBOURS)


def jakteristics_features(task: Task) -> dict[str, NDArray[np.float32]]:
    """Run jakteristics with all its features."""
    import jakteristics
    from jakteristics.constants import FEATURE_NAMES

    names = list(FEATURE_NAMES)
    columns = jakteristics.compute_features(
        task.points, task.radii[-1], num_threads=os.cpu_count(), feature_names=names
    )
    return dict(zip(names, columns.T, strict=True))


def pgeof_selected(task: Task) -> dict[str, NDArray[np.float64]]:
    """Run pgeof in float64 with all features that it has of a fixed radius."""
    import pgeof

    names = [name for name in pgeof.EFeatureID.__members__ if name != "K_optimal"]
    chosen = [pgeof.EFeatureID.__members__[name] for name in names]
    columns = pgeof.compute_features_selected(task.points, task.radii[-1], task.most, chosen)
    return dict(zip(names, columns.T, strict=True))


def pgeof_neighbours(task: Task) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.uint32]]:
    """Search with pgeof: points, neighbours by distance, and where those of each point begin."""
    import pgeof

    points = task.points.astype(np.float32)
    rows = pgeof.radius_search(points, points, task.radii[-1], task.most)[0]
    there = rows >= 0
    begins = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
    return points, rows[there].astype(np.uint32), begins.astype(np.uint32)


def pgeof_features(task: Task, neighbours: Any) -> NDArray[np.float32]:
    """Describe all neighbours with pgeof in float32."""
    import pgeof

    return pgeof.compute_features(*neighbours, 1)


def pgeof_optimal(task: Task, neighbours: Any) -> NDArray[np.float32]:
    """Describe the number of nearest neighbours of least eigenentropy, out of as many as there are radii."""
    import pgeof

    step = max(1, round(np.diff(neighbours[2]).mean() / len(task.radii)))
    return pgeof.compute_features_optimal(*neighbours, 1, step, MIN_NEIGHBOURS)


def open3d_cloud(task: Task, _: Any = None) -> Any:
    """Compute Open3D's covariances and normals of a fixed radius."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(task.points))
    sphere = open3d.geometry.KDTreeSearchParamRadius(task.radii[-1])
    cloud.estimate_covariances(sphere)
    # With covariances there it does not search again.
    cloud.estimate_normals(sphere, fast_normal_computation=False)
    return cloud


#: The package itself, under the name that peers are compared with.
OWN = "lidar_buildings"
#: Libraries with a fixed radius.
FIXED = {
    OWN: Library("lidar_buildings", None, lambda task, _: own_features(task)),
    "jakteristics": Library("jakteristics", None, lambda task, _: jakteristics_features(task)),
    "pgeof selected": Library("pgeof", None, lambda task, _: pgeof_selected(task)),
    "pgeof": Library("pgeof", pgeof_neighbours, pgeof_features),
    "open3d": Library("open3d", None, open3d_cloud),
}
#: Libraries that choose the size of the neighbourhood.
CHOSEN = {
    OWN: FIXED[OWN],
    "pgeof optimal": Library("pgeof", pgeof_neighbours, pgeof_optimal),
}


def edge_radii(spacing: float) -> NDArray[np.float64]:
    """Return the radii that edge labelling chooses from by default."""
    config = EdgeLabellingConfig()
    return np.geomspace(MIN_RADIUS, config.max_radius, config.n_radii) * spacing


def own_edges(task: Task, is_given: bool) -> NDArray[np.uint8]:
    """Label edges with the default parameters; the spacing is measured if it is not given."""
    spacing = float(task.radii[0]) / MIN_RADIUS
    return label_edges(task.points, point_spacing=spacing if is_given else None).edge


#: Edge labelling as a whole, beside the features that are a part of it.
LABELS = {
    OWN: FIXED[OWN],
    "label_edges": Library("lidar_buildings", None, lambda task, _: own_edges(task, True)),
    "label_edges, spacing measured": Library("lidar_buildings", None, lambda task, _: own_edges(task, False)),
}
