"""
Where libraries mean the same by a feature: how far they differ.

Peers that mean something else by the same word are compared by their own formula, computed from this
package's eigenvalues λ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.edges.feature_peers import Task, jakteristics_features, open3d_cloud, pgeof_selected
from lidar_buildings.core.surfaces.eigenfeatures import EigenFeatures, eigen_features

#: Fewest neighbours with which all peers compute something.
FEWEST = 4
#: λ1 − λ2 and λ2 − λ3, in parts of λ1, from which on axes are well defined: where the two are the same they
#: may point anywhere.
MIN_GAP = 0.01
#: What pgeof adds to denominators and to what it takes a logarithm of.
PGEOF_EPSILON = 1e-3


class Difference(NamedTuple):
    """How far a peer's feature is from ours."""

    #: Whose, and which.
    library: str
    feature: str
    largest: float  #: of all points that are compared; eigenvalues in parts of λ1
    n_points: int  #: how many are
    remark: str  #: how the peer's definition differs from ours


def differences(library: str, task: Task) -> list[Difference]:
    """Compare a library's features of a fixed radius with ours; none where there is nothing to compare."""
    compare: Callable[[Task, EigenFeatures], Iterator[Difference]] | None = COMPARISONS.get(library)
    if compare is None:
        return []
    return list(compare(task, eigen_features(task.points, [task.radii[-1]])))


def _largest(difference: NDArray[np.float64], kept: NDArray[np.bool_]) -> tuple[float, int]:
    """Return the largest absolute value among those kept, and how many they are."""
    return float(np.abs(difference[kept]).max(initial=0.0)), int(kept.sum())


def _distinct(own: EigenFeatures) -> NDArray[np.bool_]:
    """Tell where all three eigenvalues differ enough."""
    return -np.diff(own.eigenvalues, axis=1).max(axis=1) > MIN_GAP * own.eigenvalues[:, 0]


def _of_jakteristics(task: Task, own: EigenFeatures) -> Iterator[Difference]:
    """Compare eigenvalues, features of them, and axes."""
    peer = jakteristics_features(task)
    n = own.n_neighbours
    used = n >= FEWEST
    yield Difference("jakteristics", "neighbours", *_largest(n - peer["number_of_neighbors"], used), "")
    used &= n == peer["number_of_neighbors"]
    share = (n - 1) / n / np.maximum(own.eigenvalues[:, 0], 1e-300)
    sample = "theirs divides by n − 1: corrected"
    for k in range(3):
        off = peer[f"eigenvalue{k + 1}"] * share - own.eigenvalues[:, k] / own.eigenvalues[:, 0].clip(1e-300)
        yield Difference("jakteristics", f"λ{k + 1}/λ1", *_largest(off, used), sample)
    for name in ("linearity", "planarity", "sphericity"):
        mine = getattr(own, "scattering" if name == "sphericity" else name)
        yield Difference("jakteristics", name, *_largest(peer[name] - mine, used), "")
    sure, remark = used & _distinct(own), "where λ differ by 1 %"
    yield Difference(
        "jakteristics", "verticality", *_largest(peer["verticality"] - own.verticality, sure), remark
    )
    sine = np.linalg.norm(
        np.cross(np.column_stack([peer["nx"], peer["ny"], peer["nz"]]), own.normals), axis=1
    )
    yield Difference("jakteristics", "normal (sine)", *_largest(sine, sure), remark)


def _of_pgeof(task: Task, own: EigenFeatures) -> Iterator[Difference]:
    """Compare pgeof's formulas, which are of σ = √λ and have 0.001 added, and normals."""
    peer, used = pgeof_selected(task), own.n_neighbours >= FEWEST
    s1, s2, s3 = np.sqrt(own.eigenvalues).T
    of_sigma = "of σ = √λ, divided by σ1 + 0.001: by its formula"
    expected = {
        "Length": (s1, "is σ1"),
        "Linearity": ((s1 - s2) / (s1 + PGEOF_EPSILON), of_sigma),
        "Planarity": ((s2 - s3) / (s1 + PGEOF_EPSILON), of_sigma),
        "Scattering": (s3 / (s1 + PGEOF_EPSILON), of_sigma),
        "Curvature": (s3 / (s1 + s2 + s3 + PGEOF_EPSILON), "of σ, 0.001 added: by its formula"),
        "Eigentropy": (_pgeof_entropy(own), "0.001 added to each logarithm: by its formula"),
    }
    for name, (values, remark) in expected.items():
        yield Difference("pgeof selected", name.lower(), *_largest(peer[name] - values, used), remark)
    sure = used & _distinct(own)
    off = peer["Verticality"] - own.verticality
    yield Difference("pgeof selected", "verticality", *_largest(off, sure), "where λ differ by 1 %")


def _pgeof_entropy(own: EigenFeatures) -> NDArray[np.float64]:
    shares = own.eigenvalues / (own.eigenvalues.sum(axis=1, keepdims=True) + PGEOF_EPSILON)
    return -(shares * np.log(shares + PGEOF_EPSILON)).sum(axis=1)


def _of_open3d(task: Task, own: EigenFeatures) -> Iterator[Difference]:
    """Compare the eigenvalues of Open3D's covariances by LAPACK, and normals."""
    cloud, used = open3d_cloud(task), own.n_neighbours >= FEWEST
    values = np.linalg.eigvalsh(np.asarray(cloud.covariances))[:, ::-1]
    off = np.abs(values - own.eigenvalues).max(axis=1) / own.eigenvalues[:, 0].clip(1e-300)
    yield Difference("open3d", "λ/λ1", *_largest(off, used), "of its covariances, by LAPACK")
    sine = np.linalg.norm(np.cross(np.asarray(cloud.normals), own.normals), axis=1)
    yield Difference(
        "open3d", "normal (sine)", *_largest(sine, used & _distinct(own)), "where λ differ by 1 %"
    )


#: Library of `FIXED` → what is compared; pgeof in float32 is the same as ``pgeof selected`` but for rounding.
COMPARISONS = {"jakteristics": _of_jakteristics, "pgeof selected": _of_pgeof, "open3d": _of_open3d}
