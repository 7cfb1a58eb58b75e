"""
Known clouds as if they had been recorded otherwise: what a method must not mind.

    for one in disturbances(points, columns):
        result = method(one.points, **one.columns)
        judge(result, labels[one.rows])         # labels of the cloud's points
        judge(result, one.moved(wireframe))     # a reference in the cloud's coordinates

Every disturbance is drawn from a seed and its own name: leaving some out does not change the others.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Sides of windows [m], at most this share of the cloud's shorter side.
WINDOW_SIDES, MAX_WINDOW_SHARE = (40.0, 150.0), 0.75
#: Widths of strips and radii of discs without points [m], at most that share of the cloud's shorter side.
STRIP_WIDTHS, DISC_RADII, MAX_GAP_SHARE = (5.0, 25.0), (5.0, 20.0), 0.15
#: Discs a cloud.
N_DISCS = 6
#: Standard deviation of the noise along each axis [m].
NOISE = 0.03
#: Largest factor of stretching, and one over the smallest.
MAX_STRETCH = 1.4
#: Scan lines are so many times as far apart as points along them.
LINE_RATIO = 3
#: Fewest points that are a cloud.
MIN_POINTS = 50


@dataclass(frozen=True, eq=False)
class Disturbed:
    """A disturbed cloud."""

    #: A key of `KINDS`, and that with a number.
    kind: str
    name: str
    rows: NDArray[np.intp]  #: which of the cloud's points it has, in its order, shape (n,)
    points: NDArray[np.float64]  #: where they lie now [m], shape (n, 3)
    columns: dict[str, NDArray[Any]]  #: those of the cloud's columns that go with them
    #: How the cloud was turned or stretched, and moved then; x and y do not depend on z. Shape (3, 3).
    matrix: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    shift: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    def moved(self, coordinates: ArrayLike) -> NDArray[np.float64]:
        """Carry coordinates of a reference, (m, 2) or (m, 3), to where the cloud lies now."""
        at = np.array(coordinates, dtype=np.float64)
        n = at.shape[1]
        return at @ self.matrix[:n, :n].T + self.shift[:n]


class _Source:
    """A cloud, and the chance that disturbs it."""

    def __init__(self, points: NDArray[np.float64], columns: Mapping[str, NDArray[Any]], seed: list[int]):
        self.points, self.columns, self.chance = points, columns, np.random.default_rng(seed)
        self.low, self.extent = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0)

    def kept(self, rows: NDArray[Any], ordered: bool = True) -> dict[str, Any]:
        """Return what is left of the cloud; without columns where nothing tells of the scan any more."""
        rows = np.flatnonzero(rows) if rows.dtype == bool else rows
        columns = {name: column[rows] for name, column in self.columns.items()} if ordered else {}
        return {"rows": rows, "points": self.points[rows], "columns": columns}

    def mapped(self, matrix: NDArray[np.float64], shift: NDArray[np.float64] | float = 0.0) -> dict[str, Any]:
        """Return the whole cloud elsewhere."""
        found, shift = self.kept(np.arange(len(self.points))), np.zeros(3) + shift
        return found | {"points": self.points @ matrix.T + shift, "matrix": matrix, "shift": shift}

    def somewhere(self) -> NDArray[np.float64]:
        """Return one of the cloud's points in plan."""
        return self.points[self.chance.integers(len(self.points)), :2]

    def size(self, limits: tuple[float, float], share: float) -> float:
        """Draw a length that the cloud has room for [m]."""
        return float(np.minimum(self.chance.uniform(*limits), share * self.extent.min()))


def _window(source: _Source) -> dict[str, Any]:
    half = 0.5 * source.size(WINDOW_SIDES, MAX_WINDOW_SHARE)
    middle = np.clip(source.somewhere(), source.low + half, source.low + source.extent - half)
    return source.kept((abs(source.points[:, :2] - middle) <= half).all(axis=1))


def _strip(source: _Source) -> dict[str, Any]:
    angle, width = source.chance.uniform(0.0, math.pi), source.size(STRIP_WIDTHS, MAX_GAP_SHARE)
    across = (source.points[:, :2] - source.somewhere()) @ (-math.sin(angle), math.cos(angle))
    return source.kept(abs(across) > 0.5 * width)


def _discs(source: _Source) -> dict[str, Any]:
    left = np.ones(len(source.points), dtype=bool)
    for _ in range(N_DISCS):
        away = np.hypot(*(source.points[:, :2] - source.somewhere()).T)
        left &= away > source.size(DISC_RADII, MAX_GAP_SHARE)
    return source.kept(left)


def _thinned(share: float) -> Callable[[_Source], dict[str, Any]]:
    """Keep a share of the pulses, all returns of each; of the points where times are not known."""

    def thin(source: _Source) -> dict[str, Any]:
        time = source.columns.get("gps_time", np.arange(len(source.points)))
        pulses, pulse = np.unique(time, return_inverse=True)
        if len(pulses) < share * len(time):
            pulses = pulse = np.arange(len(source.points))
        return source.kept((source.chance.random(len(pulses)) < share)[pulse.ravel()])

    return thin


def _rotated(source: _Source) -> dict[str, Any]:
    angle = math.radians(source.chance.uniform(5.0, 355.0))
    cos, sin = math.cos(angle), math.sin(angle)
    return source.mapped(np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]))


def _stretched(source: _Source) -> dict[str, Any]:
    """Make all of it smaller or larger, in plan and upwards, as if other houses stood on other hills."""
    plan, height = np.exp(source.chance.uniform(-1.0, 1.0, 2) * math.log(MAX_STRETCH))
    return source.mapped(np.diag([plan, plan, height]))


def _shifted(source: _Source) -> dict[str, Any]:
    shift = np.append(source.chance.uniform(0.0, 100.0, 2), 0.0)
    return source.mapped(np.eye(3), shift)


def _noisy(source: _Source) -> dict[str, Any]:
    noise = source.chance.normal(0.0, NOISE, source.points.shape)
    return source.kept(np.arange(len(source.points))) | {"points": source.points + noise}


def _shuffled(source: _Source) -> dict[str, Any]:
    return source.kept(source.chance.permutation(len(source.points)), ordered=False)


def _lines(source: _Source) -> dict[str, Any]:
    """Cut the cloud into strips of one spacing and keep one of `LINE_RATIO`: lines far apart."""
    angle = source.chance.uniform(0.0, math.pi)
    spacing = math.sqrt(float(np.prod(source.extent)) / len(source.points))
    across = source.points[:, :2] @ (-math.sin(angle), math.cos(angle))
    return source.kept(np.floor(across / spacing) % LINE_RATIO == 0, ordered=False)


#: Kind → how often it is drawn, and what it does.
KINDS: dict[str, tuple[int, Callable[[_Source], dict[str, Any]]]] = {
    "window": (6, _window),
    "strip": (2, _strip),
    "discs": (2, _discs),
    "half": (1, _thinned(0.5)),
    "quarter": (1, _thinned(0.25)),
    "rotated": (2, _rotated),
    "shifted": (2, _shifted),
    "noisy": (1, _noisy),
    "shuffled": (1, _shuffled),
    "lines": (2, _lines),
    "stretched": (3, _stretched),
}


def disturbances(
    points: NDArray[np.float64],
    columns: Mapping[str, NDArray[Any]] | None = None,
    *,
    kinds: Collection[str] = tuple(KINDS),
    quick: bool = False,
    seed: int = 0,
) -> Iterator[Disturbed]:
    """
    Yield disturbed versions of a cloud, every kind as often as `KINDS` says, or once if `quick`.

    Points are in the order of the file, (n_points, 3) [m]; `columns` are what else is known of them: thinning
    goes by the pulses of `gps_time`. The seed is best another one for every cloud.
    """
    for kind in kinds:
        n_copies, disturb = KINDS[kind]
        for copy in range(1 if quick else n_copies):
            source = _Source(points, columns or {}, [seed, zlib.crc32(kind.encode()), copy])
            found = disturb(source)
            if len(found["rows"]) >= MIN_POINTS:
                yield Disturbed(kind, f"{kind} {copy + 1}", **found)
