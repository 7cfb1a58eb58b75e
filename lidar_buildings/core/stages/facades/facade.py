"""What is found of a façade."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Kinds of façades: on a straight line, or on an arc of a circle.
STRAIGHT, ARC = "straight", "arc"
#: Building of a façade of which none is known.
NO_BUILDING = -1
_NUMBERS = ("bottom", "top", "coverage", "sigma", "confidence")
_COUNTS = ("n_points", "building_id", "facade_id")
#: Vertices nearer to each other are one [m].
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Facade:
    """A wall as it was seen from the street; its front is on the left of its foot line."""

    foot: NDArray[np.float64]  #: line in plan on which it stands, map frame [m], shape (n_vertices ≥ 2, 2)
    bottom: float  #: elevations between which it was seen [m]
    top: float
    #: Which steps of the foot line were seen, evenly from its first vertex to the last, about
    #: `lidar_buildings.core.stages.facades.walls.BIN` long each.
    is_seen: NDArray[np.bool_]
    coverage: float  #: share of the rectangle above the foot line, from bottom to top, that was seen
    sigma: float  #: of the points on it about the wall [m]
    n_points: int  #: on it
    confidence: float  #: 0 to 1 that it is of a building
    kind: str  #: `STRAIGHT` or `ARC`
    building_id: int = NO_BUILDING  #: see `lidar_buildings.core.model.ids`
    facade_id: int = 0  #: 1 to 2³² − 1, another one for each façade of a survey; 0 if not numbered
    is_core: bool = True  #: False if points of a neighbouring tile show it, whose façade it is
    #: Points seen under eaves in front of it, some of them [m], shape (n, 3).
    under_eaves: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))

    @property
    def ring(self) -> NDArray[np.float64]:
        """Corners of the upright face: along its foot at the bottom, back at the top, shape (2 n, 3)."""
        low, high = (np.insert(self.foot, 2, z, axis=1) for z in (self.bottom, self.top))
        return np.concatenate([low, high[::-1]])

    @property
    def stretches(self) -> list[tuple[NDArray[np.float64], bool]]:
        """Pieces of the foot line, all of which were seen, or not, each with its vertices, shape (n, 2)."""
        steps = np.hypot(*np.diff(self.foot, axis=0).T)
        reached = np.concatenate([[0.0], np.cumsum(steps)])
        n = len(self.is_seen)
        bounds = [0, *(np.flatnonzero(np.diff(self.is_seen)) + 1).tolist(), n]
        pieces = []
        for begin, end in pairwise(bounds):
            low, high = begin / n * reached[-1], end / n * reached[-1]
            inner = reached[(reached > low + _SAME) & (reached < high - _SAME)]
            places = np.concatenate([[low], inner, [high]])
            line = np.column_stack([np.interp(places, reached, axis) for axis in self.foot.T])
            pieces.append((line, bool(self.is_seen[begin])))
        return pieces

    @property
    def record(self) -> dict[str, Any]:
        """All that is known of it, as JSON holds it."""
        known = {one.name: getattr(self, one.name) for one in fields(self)}
        arrays = {"foot": self.foot.tolist(), "under_eaves": self.under_eaves.tolist()}
        return known | arrays | {"is_seen": self.is_seen.astype(int).tolist()}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Facade:
        """
        Return the façade of a record.

        LookupError, TypeError or ValueError if it is none.
        """
        foot = np.array(record["foot"], dtype=np.float64)
        seen = np.array(record["is_seen"], dtype=bool)
        if foot.ndim != 2 or foot.shape[1] != 2 or len(foot) < 2 or seen.ndim != 1 or not len(seen):
            raise ValueError("a foot line is two or more positions in plan, with steps that were seen or not")
        under = np.array(record["under_eaves"], dtype=np.float64).reshape(-1, 3)
        numbers = {name: float(record[name]) for name in _NUMBERS}
        if not np.isfinite([*foot.ravel(), *under.ravel(), *numbers.values()]).all():
            raise ValueError("a façade's numbers are finite")
        counts = {name: int(record[name]) for name in _COUNTS}
        known: dict[str, Any] = {**numbers, **counts, "kind": str(record["kind"])}
        return cls(foot=foot, is_seen=seen, is_core=bool(record["is_core"]), under_eaves=under, **known)

    @property
    def length(self) -> float:
        """Length of the foot line [m]."""
        return float(np.hypot(*np.diff(self.foot, axis=0).T).sum())

    @property
    def seen_share(self) -> float:
        """Share of the foot line that was seen."""
        return float(self.is_seen.mean())
