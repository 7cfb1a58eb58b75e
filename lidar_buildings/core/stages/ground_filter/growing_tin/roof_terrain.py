"""Roofs that a seed fell on: supposed terrain that meets other ground in step edges alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.ground_filter.growing_tin.candidate_links import (
    level_parts,
    nearest_by_sector,
)

# Chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: How far neighbours may be, in spacings of the candidates.
REACH = 3.0
#: Ground is connected where it rises by no more than this over its distance, or by this at all [m].
MAX_LINK_SLOPE, MIN_LINK_RISE = 0.7, 0.3
#: Fewest links to other ground that tell a roof, at all and over the root of its candidates (a square seen
#: all round has about eight): a part cut off by the data's edge may be a hill.
MIN_LINKS, MIN_BORDER = 10, 3.2
#: Share of them that have to be drops.
MIN_DROP_SHARE = 0.9
#: How far it drops at least [m].
MIN_DROP = 2.0


def find_roof_terrain(
    candidates: NDArray[np.float64], ground: NDArray[np.bool_], spacing: float, max_area: float
) -> NDArray[np.bool_]:
    """
    Return the ground candidates in parts that lie above the other ground on all sides where there is any.

    A large building at the edge of the data may be all that a seed's cell shows; it then becomes terrain. Its
    walls tell it from a hill, whose foot is linked to the ground around.

    Arguments are those of `find_landforms`; what is larger than `max_area` [m²] is a plateau.
    """
    rows = np.flatnonzero(ground)
    links = nearest_by_sector(candidates, rows, REACH * spacing)
    part = level_parts(candidates, rows, links, MAX_LINK_SLOPE, MIN_LINK_RISE)
    size, n_links, n_drops = _count_drops(candidates, rows, links, part, MIN_DROP).T
    is_roof = (n_drops >= MIN_DROP_SHARE * n_links) & (size * spacing**2 <= max_area)
    is_roof &= n_links >= np.maximum(MIN_LINKS, MIN_BORDER * np.sqrt(size))
    found = np.zeros_like(ground)
    found[rows] = is_roof[part]
    return found


@kernel
def _count_drops(candidates, rows, links, part, min_drop):  # type: ignore[no-untyped-def]
    """Return each part's size, its links to other ground, and how many of them drop."""
    place = np.full(len(candidates), -1, dtype=np.int32)
    place[rows] = np.arange(len(rows))
    counts = np.zeros((len(rows), 3))
    for r in range(len(rows)):
        counts[part[r], 0] += 1.0
        for j in links[r]:
            if j < 0 or place[j] < 0 or part[place[j]] == part[r]:
                continue
            counts[part[r], 1] += 1.0
            counts[part[r], 2] += 1.0 if candidates[rows[r], 2] - candidates[j, 2] >= min_drop else 0.0
    return counts
