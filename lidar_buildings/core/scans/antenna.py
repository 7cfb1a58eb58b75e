"""Where the antenna of satellite positions was in the frame in which scans are placed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.scans.placing import ScanPlacer

#: What moves, where nothing but /tf tells of it (REP-105).
_BODY = "base_link"
_Place = tuple[float, float, float]


class Antenna(NamedTuple):
    """An antenna on what the poses move."""

    frame: str  #: where it is fixed
    target: str  #: the frame in which scans are placed
    place: _Place  #: in its frame [m]

    @classmethod
    def of(cls, frame: str, placer: ScanPlacer) -> Antenna | None:
        """
        Return the antenna whose positions are told in a frame, None if nothing tells how that moves.

        The frame counts if transforms tell of it, but not that it moves against what odometry moves, or
        `base_link`, and the parameter `antenna` is empty; else the antenna is at the origin of that.
        """
        tree, body = placer.tree, placer.odometry_child or _BODY
        is_other = frame not in tree.frames or (tree.has_way(frame, body) and tree.moves(frame, body))
        own = body if is_other or placer.config.antenna.strip() else frame
        target = placer.target or placer.target_of(own)
        if not (tree.has_way(own, target) and tree.moves(own, target)):
            return None
        return cls(own, target, placer.config.antenna_place())

    def places(
        self, placer: ScanPlacer, times: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return where it was at some times [ns], shape (n, 3) [m], and whether that is known."""
        poses = placer.tree.poses(self.frame, self.target, times)
        return poses.apply(np.tile(self.place, (len(times), 1))), poses.is_known

    def known_until(self, placer: ScanPlacer) -> int:
        """Return the time of the last pose that tells of it [ns]."""
        return placer.tree.known_until(self.frame, self.target) or 0
