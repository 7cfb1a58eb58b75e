"""What became of the points that were clustered together."""

from __future__ import annotations

from collections.abc import Iterable

#: There were two clusters, edges and surfaces.
OK = "ok"
#: What k-means parts are halves of one cluster: typical centres stood for its own.
ONE_CLUSTER = "one_cluster"
#: A small roof: typical centres stood for its own. Of fewer than two distinct points none is an edge.
TOO_FEW_POINTS = "too_few_points"


def overall(statuses: Iterable[str]) -> str:
    """Return the best of several statuses, that of no points if there are none."""
    found = set(statuses)
    return next((one for one in (OK, ONE_CLUSTER) if one in found), TOO_FEW_POINTS)
