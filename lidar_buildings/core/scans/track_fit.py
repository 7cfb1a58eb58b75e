"""Where a track of poses lies by positions seen at their times, and how it is turned if these show that."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Places along a track that speak for it are a hundredth of its extent apart, so that where it stood long
#: counts no more than where it moved, and these are the most.
_SHARE, _MOST_WAYPOINTS = 0.01, 500
#: Pairs of them by which the yaw is tried: with half of them wrong one in four is good.
_N_TRIALS = 300
#: Positions further from the track than so many standard errors are left out; of normal ones 1 in 3000.
_MOST_ERRORS = 4.0
#: A yaw counts that is so many standard errors from 0 …
_SIGNIFICANT = 3.0
#: … if so many of them are less than this [rad], and there are so many positions.
_MOST_YAW, _LEAST_USED = math.radians(10.0), 10
#: Medians over standard errors: of the lengths of plane vectors with normal errors, of such errors.
_MEDIAN_LENGTH, _MEDIAN_ERROR = 1.1774, 0.6745
#: Rounds of fitting to those that are used; they settle within three or four.
_N_ROUNDS = 10
#: Errors that positions and poses have at least [m]: of clocks, and of where the antenna is.
_LEAST_ERROR = 0.02

_Plan = NDArray[np.complex128]
_Floats = NDArray[np.float64]


class TrackFit(NamedTuple):
    """Where a track lies: it is turned counter-clockwise by `yaw`, and then shifted."""

    yaw: float  #: [rad]; 0 unless the positions show that the track is turned
    shift: _Floats  #: [m], shape (3,)
    is_used: NDArray[np.bool_]  #: positions that were not left out, shape (n,)
    #: Distances of these from the track in plan, and in height [m].
    rms: float
    rms_height: float
    #: Standard error of the yaw, whether it is taken or not [rad]; infinite if nothing tells it.
    yaw_error: float

    @property
    def tells_yaw(self) -> bool:
        """Whether the positions would have shown that the track is turned."""
        return _SIGNIFICANT * self.yaw_error <= _MOST_YAW


def fit_track(track: _Floats, seen: _Floats, sigma: _Floats, *, may_turn: bool = True) -> TrackFit:
    """
    Fit a track of poses to positions that were seen at its times, up to half of which may be wrong.

    The yaw is tried by pairs of positions for the least median of distances (Rousseeuw 1984), and fitted to
    all that agree (Umeyama 1991, in plan). It is taken if it is three standard errors from 0; errors that
    follow one another, as those of satellites do, count as fewer (Bartlett 1946).

    Track and positions seen are (n, 3) in the order of time, one at least; z points up [m]. `sigma` are
    standard errors of the positions, or numbers in proportion to them. The track is turned only if it
    `may_turn`.

    >>> track = np.array([[k, k % 7, 0.0] for k in range(50)])
    >>> seen = track[:, [1, 0, 2]] * [-1, 1, 1] + 5.0
    >>> seen[0] += 60.0
    >>> fit = fit_track(track, seen, np.ones(50))
    >>> round(math.degrees(fit.yaw), 6), np.round(fit.shift, 6).tolist(), int(fit.is_used.sum())
    (90.0, [5.0, 5.0, 5.0], 49)
    """
    plan, wanted = (one[:, 0] + 1j * one[:, 1] for one in (track, seen))
    way = _waypoints(plan)
    turn, shift, is_used = _refined(plan, wanted, sigma, way, _tried_turn(plan[way], wanted[way], sigma[way]))
    yaw = float(np.angle(turn))
    error = _yaw_error(plan[is_used], (wanted - turn * plan - shift)[is_used], sigma[is_used])
    if not may_turn or _SIGNIFICANT * error > min(abs(yaw), _MOST_YAW):
        turn, shift, is_used = _refined(plan, wanted, sigma, way)
        yaw = 0.0
    rises = (seen - track)[is_used, 2]
    rise, rms_height = _robust_mean(rises)
    rms = math.sqrt(np.mean(np.abs(wanted - turn * plan - shift)[is_used] ** 2))
    return TrackFit(yaw, np.array([shift.real, shift.imag, rise]), is_used, rms, rms_height, error)


def _waypoints(plan: _Plan) -> NDArray[np.intp]:
    """Return some positions along a track, evenly by the way that it has taken."""
    step = _SHARE * math.hypot(np.ptp(plan.real), np.ptp(plan.imag))
    last, found = plan[0], [0]
    for k, place in enumerate(plan[1:].tolist(), 1):
        if abs(place - last) >= step:
            last = place
            found.append(k)
    return np.array(found)[np.linspace(0, len(found) - 1, min(len(found), _MOST_WAYPOINTS)).astype(np.intp)]


def _tried_turn(plan: _Plan, wanted: _Plan, sigma: _Floats) -> complex:
    """Return the turn by two positions with which the most agree, as a number of length 1."""
    first, second = np.random.default_rng(0).integers(0, len(plan), (2, _N_TRIALS))
    turns = (wanted[second] - wanted[first]) * np.conj(plan[second] - plan[first])
    turns = turns[turns != 0.0]
    if not len(turns):
        return 1.0 + 0.0j
    turns /= np.abs(turns)
    rest = wanted - turns[:, None] * plan
    rest -= _median(rest)[:, None]
    return complex(turns[np.argmin(np.median(np.abs(rest) / sigma, axis=1))])


def _refined(
    plan: _Plan, wanted: _Plan, sigma: _Floats, way: NDArray[np.intp], turn: complex | None = None
) -> tuple[complex, complex, NDArray[np.bool_]]:
    """Return turn, shift and who is used, fitted in turns; without a turn to begin with there is none."""
    is_free, turn = turn is not None, turn or 1.0 + 0.0j
    shift = complex(_median(wanted[way] - turn * plan[way]))
    is_used = np.zeros(len(plan), dtype=np.bool_)
    for _ in range(_N_ROUNDS):
        before, rest = is_used, np.abs(wanted - turn * plan - shift)
        scale = float(np.median(rest[way] / sigma[way])) / _MEDIAN_LENGTH
        is_used = rest <= _MOST_ERRORS * np.maximum(scale * sigma, _LEAST_ERROR)
        if (is_used == before).all():
            break
        weights = is_used / sigma**2
        middle, aim = (np.average(one, weights=weights) for one in (plan, wanted))
        product = np.sum(weights * np.conj(plan - middle) * (wanted - aim))
        if is_free and product:
            turn = complex(product / abs(product))
        shift = complex(aim - turn * middle)
    return turn, shift, is_used


def _yaw_error(plan: _Plan, rest: _Plan, sigma: _Floats) -> float:
    """Return the standard error of a yaw [rad] by what is left between positions and track."""
    weights = sigma**-2.0
    spread = math.sqrt(np.average(np.abs(plan - np.average(plan, weights=weights)) ** 2, weights=weights))
    if len(plan) < _LEAST_USED or not spread:
        return math.inf
    power = np.abs(rest) ** 2
    following = float(np.sum(rest[1:] * np.conj(rest[:-1])).real / max(power.sum(), 1e-12))
    alike = max(following, 0.0)
    n_single = max(len(plan) * (1.0 - alike) / (1.0 + alike), 1.0)
    error = math.sqrt(np.average(power, weights=weights) / 2.0 / n_single)
    return math.hypot(error, _LEAST_ERROR) / spread


def _robust_mean(values: _Floats) -> tuple[float, float]:
    """Return the mean of the values that agree, and what the root of their mean square is about it."""
    away = np.abs(values - np.median(values))
    limit = _MOST_ERRORS * max(float(np.median(away)) / _MEDIAN_ERROR, _LEAST_ERROR)
    agreeing = values[away <= limit]
    return float(agreeing.mean()), float(agreeing.std())


def _median(plan: _Plan) -> _Plan:
    """Return the median of complex numbers, of both parts by themselves, along the last axis."""
    middle: _Plan = np.median(plan.real, axis=-1) + 1j * np.median(plan.imag, axis=-1)
    return middle
