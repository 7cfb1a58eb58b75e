"""What the points of a cloud say that can hardly be so: gathered while they are read, told as remarks."""

from __future__ import annotations

from collections.abc import Iterator

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import BEYOND, are_held
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.point_columns import xyz_of

#: The least and the greatest number that a coordinate has in a file.
_LIMITS = np.iinfo(np.int32)
#: Points that are kept of a chunk, and of a file.
_OF_CHUNK, _OF_FILE = 20_000, 200_000
#: Stretches of a file from which points are sampled.
_N_STRETCHES = 5
#: Fewer points say nothing.
_FEW = 100
#: Part of the point spacing that the coordinates' steps should not exceed.
_FINE = 0.25
#: Standard deviation of points about a line or a plane that no scanner reaches [m].
_EXACT = 0.003
#: Points that tell together in which steps a coordinate is: few enough for a median to leave out others.
_OF_STEP = 32
#: Share of the points at the very end of an axis at which they were cut off; level ground is no such end, but
#: so far below all else it is [m].
_CUT_OFF, _FAR_BELOW = 0.05, 20.0
#: Elevations of the lowest and the highest land, with a margin [m].
_LOWEST, _HIGHEST = -600.0, 9000.0
#: Nothing is so far above or below all else that a scanner sees from the air, not even cliffs [m].
_APART = 300.0
#: Axes are taken for swapped where the survey is so thick in z [m], so many times less in the other axis, and
#: that one is so many times less scattered over the others than z is.
_THICK, _THINNER, _STEADIER = 20.0, 2.0, 4.0
#: Points that a cell has in which that scatter is measured.
_OF_CELL = 30
#: Share of points whose returns contradict each other that is told, and so do first returns that lie so far
#: below the last ones of the same pulses, on average [m].
_WRONG, _BELOW = 0.01, 0.3
#: Points follow one another in space if they are so much nearer than any two are; strips are flown so long
#: after one another [s].
_NEARER, _TURN = 0.7, 60.0

_AXES = "xyz"


class CloudDoubts:
    """
    Gathers what tells whether a cloud's points can be so, chunk by chunk.

    With a frame, the points that it cannot hold are told apart.
    """

    def __init__(self, cloud: Cloud, frame: MapFrame | None = None, label: str = "") -> None:
        self._label, self._units = label or str(cloud.path), np.asarray(cloud.units)
        self._scales, self._offsets = np.array(cloud.header.scales), np.array(cloud.header.offsets)
        self._frame = frame
        self._has_time = "gps_time" in cloud.header.point_format.dimension_names
        self._total, self._n, self._n_of_sample = cloud.point_count, 0, 0
        self._sample: list[NDArray[np.int64]] = []
        self._sampled_columns: list[dict[str, NDArray[np.float64]]] = []
        self._n_at_limit = np.zeros(3, dtype=np.int64)
        self._ends: dict[str, tuple[float, float]] = {}
        self._n_beyond = self._n_wrong = 0
        self._low, self._high = np.full(3, _LIMITS.max), np.full(3, _LIMITS.min)

    def add(self, chunk: laspy.ScaleAwarePointRecord) -> NDArray[np.bool_] | None:
        """Take some points; tell which of them the frame cannot hold, None if it holds all."""
        if not len(chunk):
            return None
        self._n += len(chunk)
        raw = [np.asarray(chunk.array[name]) for name in "XYZ"]
        for axis, values in enumerate(raw):
            low, high = int(values.min()), int(values.max())
            self._low[axis], self._high[axis] = min(self._low[axis], low), max(self._high[axis], high)
            # some writers clamp symmetrically
            if low <= _LIMITS.min + 1 or high == _LIMITS.max:
                at_limit = (values <= _LIMITS.min + 1) | (values == _LIMITS.max)
                self._n_at_limit[axis] += np.count_nonzero(at_limit)
        columns = {"return": np.asarray(chunk.return_number), "returns": np.asarray(chunk.number_of_returns)}
        columns["strip"], columns["intensity"] = chunk.array["point_source_id"], chunk.array["intensity"]
        if self._has_time:
            columns["time"] = chunk.array["gps_time"]
        for name, column in columns.items():
            low, high = self._ends.get(name, (np.inf, -np.inf))
            ends = np.fmin.reduce(column), np.fmax.reduce(column)
            self._ends[name] = (float(np.fmin(low, ends[0])), float(np.fmax(high, ends[1])))
        self._n_wrong += int(np.count_nonzero(columns["return"] > columns["returns"]))
        if self._n_of_sample < _OF_FILE:
            step = max(1, len(chunk) // _OF_CHUNK)
            self._sample.append(np.column_stack([values[::step] for values in raw]).astype(np.int64))
            self._sampled_columns.append({name: one[::step].astype(float) for name, one in columns.items()})
            self._n_of_sample += len(self._sample[-1])
        return self._beyond(chunk)

    def _beyond(self, chunk: laspy.ScaleAwarePointRecord) -> NDArray[np.bool_] | None:
        if self._frame is None:
            return None
        corners = np.array([self._low, self._high]) * self._scales + self._offsets
        if are_held(self._frame.to_map(corners)).all():
            return None
        beyond = ~are_held(self._frame.to_map(xyz_of(chunk)))
        self._n_beyond += int(np.count_nonzero(beyond))
        return beyond

    def remarks(self) -> list[Remark]:
        """Return a remark for each thing that can hardly be so."""
        if self._n < _FEW:
            return []
        raw = np.concatenate(self._sample)
        points = (raw * self._scales + self._offsets) * self._units
        kept = self._sampled_columns
        columns = {name: np.concatenate([one[name] for one in kept]) for name in kept[0]}
        is_main = _main_layer(points[:, 2])
        found = [
            *self._of_range(raw),
            *self._of_steps(raw),
            *self._of_shape(points),
            *self._of_elevations(points, is_main),
            *self._of_columns(),
            *self._of_order(points, columns),
        ]
        return [Remark(code, f"{self._label}: {text}") for code, text in found]

    def _of_range(self, raw: NDArray[np.int64]) -> Iterator[tuple[str, str]]:
        for axis in range(3):
            number, (low, high) = int(self._n_at_limit[axis]), (self._low[axis], self._high[axis])
            if number:
                yield (
                    "integer_limit",
                    f"{_AXES[axis]} of {number:,} points is the limit of the file's integers: they were "
                    "written with a wrong offset or scale",
                )
            for end, name in ((low, "least"), (high, "greatest")) if not number else ():
                is_end = raw[:, axis] == end
                step = np.abs(raw[~is_end, axis] - end).min(initial=_LIMITS.max) * self._scales[axis]
                is_level = axis == 2 and step * self._units[2] < _FAR_BELOW
                if _CUT_OFF < (share := is_end.mean()) < 1.0 and not is_level:
                    place = end * self._scales[axis] + self._offsets[axis]
                    yield (
                        "cut_off",
                        f"{_AXES[axis]} of {share:.0%} of the points is {place:g}, the {name} of all: cut "
                        "off there, or a value for no data?",
                    )
        if self._n_beyond:
            yield "beyond_limits", f"{self._n_beyond:,} points are noise: {BEYOND}"

    def _of_steps(self, raw: NDArray[np.int64]) -> Iterator[tuple[str, str]]:
        extent = ((self._high.astype(float) - self._low) * self._scales * self._units)[:2]
        if not extent.all():
            return
        spacing = float(np.sqrt(extent.prod() / max(self._total, 1)))
        n_groups = len(raw) // _OF_STEP
        groups = raw[: n_groups * _OF_STEP].reshape(_OF_STEP, n_groups, 3)
        steps = np.median(np.gcd.reduce(groups - groups[0], axis=0), axis=0) * self._scales * self._units
        if len(coarse := np.flatnonzero(steps > _FINE * spacing)):
            names = " and ".join(_AXES[k] for k in coarse)
            have = "has" if len(coarse) == 1 else "have"
            yield (
                "coarse_steps",
                f"{names} {have} steps of {steps[coarse].max():.3g} m, where points are {spacing:.2g} m "
                "apart: export again with a finer scale",
            )

    def _of_shape(self, points: NDArray[np.float64]) -> Iterator[tuple[str, str]]:
        same = [_AXES[k] for k in range(3) if self._low[k] == self._high[k]]
        if same:
            verb = "is" if len(same) == 1 else "are"
            yield "flat", f"{' and '.join(same)} {verb} the same at all points: no survey is so flat"
            return
        _, deviations, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        across = deviations[1:] / np.sqrt(len(points))
        if across[0] < _EXACT:
            yield "flat", "all points lie on one line: this is no survey of an area"
        elif across[1] < _EXACT:
            yield "flat", "all points lie in one plane: no scanner measures so exactly"

    def _of_elevations(
        self, points: NDArray[np.float64], is_main: NDArray[np.bool_]
    ) -> Iterator[tuple[str, str]]:
        heights = points[is_main, 2]
        if not _LOWEST <= np.median(heights) <= _HIGHEST:
            yield (
                "odd_elevations",
                f"elevations of {heights.min():,.0f} to {heights.max():,.0f} m are of no land: another unit, "
                "another axis, flying altitudes?",
            )
            return
        for code, side, is_far, what in (
            ("aloft", "above", points[:, 2] > heights.max(), "clouds, flying altitudes, another unit?"),
            ("far_below", "below", points[:, 2] < heights.min(), "values for no data, another unit?"),
        ):
            if is_far.any():
                yield (
                    code,
                    f"{max(is_far.mean(), 1e-4):.2%} of the points lie more than {_APART:.0f} m {side} all "
                    f"others: {what}",
                )
        for axis in (1, 0):
            if _is_up(points[is_main], axis):
                yield (
                    "axis_up",
                    f"heights seem to be in {_AXES[axis]}, not in z ({_AXES[axis]} up): swap the axes first",
                )
                return

    def _of_columns(self) -> Iterator[tuple[str, str]]:
        low, high = self._ends.get("time", (0.0, 1.0))
        if low == high:
            text = "0" if low == 0.0 else "the same"
            yield (
                "times_say_nothing",
                f"GPS times are all {text}: they do not tell scan lines and strips",
            )
        (low, high), (_, most) = self._ends["return"], self._ends["returns"]
        if high == 0.0 or most == 0.0:
            yield "returns_say_nothing", "return numbers are all 0: no pulse is known to have several returns"
        elif self._n_wrong > _WRONG * self._n:
            text = f"{self._n_wrong:,} points have higher return numbers than their pulses have returns"
            yield "returns_contradict", f"{text}: the returns were written wrongly"
        elif low == high:
            yield "returns_say_nothing", f"all points are return {high:.0f}: the other returns are missing"
        low, high = self._ends["strip"]
        if low == high == 0.0:
            yield "strips_say_nothing", "point source ids are all 0: they do not tell flight strips"
        low, high = self._ends["intensity"]
        if low == high != 0.0:  # 0 where there are none
            yield "intensities_say_nothing", f"intensities are all {low:.0f}: they tell no roads"

    def _of_order(
        self, points: NDArray[np.float64], columns: dict[str, NDArray[np.float64]]
    ) -> Iterator[tuple[str, str]]:
        """Tell what is contradicted by the points' places: returns, times, strips."""
        number, n_returns = columns["return"], columns["returns"]
        is_first, is_last = (n_returns > 1) & (number == 1), (n_returns > 1) & (number == n_returns)
        if not is_first.any() and np.count_nonzero(is_last) > _FEW and np.ptp(number):
            yield "returns_say_nothing", "no point is the first return of several: the first ones are missing"
        enough = min(np.count_nonzero(is_first), np.count_nonzero(is_last)) > _FEW
        if enough and points[is_first, 2].mean() < points[is_last, 2].mean() - _BELOW:
            yield (
                "returns_contradict",
                "first returns lie below last ones: z points down, or returns are numbered backwards",
            )
        times, (low, high) = columns.get("time", np.zeros(1)), self._ends.get("time", (0.0, 0.0))
        if n_unknown := np.count_nonzero(~np.isfinite(times)):
            yield (
                "times_say_nothing",
                f"GPS times of {n_unknown / len(times):.0%} of the points are no numbers",
            )
        if not low < high or n_unknown:
            return
        order = np.argsort(times, kind="stable")
        after = np.diff(times[order])
        any_two = _NEARER * _apart(points, np.random.default_rng(0).permutation(points))
        in_time = points[order]
        is_mixed = _apart(in_time[:-1], in_time[1:]) > any_two
        if is_mixed and _apart(points[:-1], points[1:]) < any_two:
            yield (
                "times_say_nothing",
                "points that follow one another in GPS time lie anywhere: times are mixed up",
            )
        low, high = self._ends["strip"]
        if low == high != 0.0 and (n := np.count_nonzero(after > _TURN)):
            yield (
                "strips_say_nothing",
                f"point source ids are all {low:.0f}, though GPS times show {n + 1} passes: they do not tell "
                "flight strips",
            )


def _apart(points: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """Return how far points lie from others in plan, the median [m]."""
    return float(np.median(np.hypot(*(points - others)[:, :2].T)))


def _main_layer(heights: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points are of the most that no gap divides."""
    order = np.argsort(heights)
    layer = np.zeros(len(heights), np.int64)
    layer[order[1:]] = np.cumsum(np.diff(heights[order]) > _APART)
    return np.asarray(layer == np.bincount(layer).argmax())


def _is_up(points: NDArray[np.float64], axis: int) -> bool:
    """Whether the points are a surface over z and the other axis rather than over x and y."""
    low, high = np.quantile(points, [0.01, 0.99], axis=0)
    extent = high - low
    if extent[2] < _THICK or extent[axis] * _THINNER > extent[2]:
        return False
    other = 1 - axis
    return _scatter(points, (other, 2), axis) * _STEADIER < _scatter(points, (0, 1), 2)


def _scatter(points: NDArray[np.float64], plan: tuple[int, int], up: int) -> float:
    """Return how much one axis scatters in cells of the two others, the median of standard deviations [m]."""
    places = points[:, plan]
    extent = np.maximum(np.ptp(places, axis=0), 1e-9)
    size = np.sqrt(extent.prod() * _OF_CELL / len(points))
    columns, rows = np.floor((places - places.min(axis=0)) / size).astype(np.int64).T
    cell = np.unique(columns * (rows.max() + 1) + rows, return_inverse=True)[1].ravel()
    count = np.bincount(cell)
    value = points[:, up] - points[:, up].mean()
    mean = np.bincount(cell, value) / count
    variance = np.bincount(cell, (value - mean[cell]) ** 2) / count
    return float(np.sqrt(np.median(variance[cell])))


def sampled_remarks(cloud: Cloud, n_points: int) -> list[Remark]:
    """Return what so many points tell, from all over a cloud; InputError if they cannot be read."""
    doubts = CloudDoubts(cloud)
    n = cloud.point_count
    every = max(-(-n // _N_STRETCHES), 1)
    size = min(max(n_points // _N_STRETCHES, 1), every)
    for _, chunk in cloud.runs([(first, min(first + size, n)) for first in range(0, n, every)]):
        doubts.add(chunk)
    return doubts.remarks()
