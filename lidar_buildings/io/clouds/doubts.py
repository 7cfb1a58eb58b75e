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
#: Fewer points say nothing.
_FEW = 100
#: Part of the point spacing that the coordinates' steps should not exceed.
_FINE = 0.25
#: Standard deviation of points about a line or a plane that no scanner reaches [m].
_EXACT = 0.003
#: Elevations of the lowest and the highest land, with a margin [m].
_LOWEST, _HIGHEST = -600.0, 9000.0
#: What lies so far above nearly all points was measured in the air [m], [share].
_ALOFT, _NEARLY_ALL = 500.0, 0.95
#: Axes are taken for swapped where the survey is so thick in z [m], so many times less in the other axis, and
#: that one is so many times less scattered over the others than z is.
_THICK, _THINNER, _STEADIER = 60.0, 2.0, 4.0
#: Points that a cell has in which that scatter is measured.
_OF_CELL = 30
#: Share of points whose returns contradict each other that is told.
_WRONG = 0.01

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
        self._n, self._n_of_sample = 0, 0
        self._sample: list[NDArray[np.int64]] = []
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
            if low == _LIMITS.min or high == _LIMITS.max:
                at_limit = (values == _LIMITS.min) | (values == _LIMITS.max)
                self._n_at_limit[axis] += np.count_nonzero(at_limit)
        columns = {"return": np.asarray(chunk.return_number), "returns": np.asarray(chunk.number_of_returns)}
        columns["strip"] = chunk.array["point_source_id"]
        if self._has_time:
            columns["time"] = chunk.array["gps_time"]
        for name, column in columns.items():
            low, high = self._ends.get(name, (np.inf, -np.inf))
            self._ends[name] = (min(low, float(column.min())), max(high, float(column.max())))
        self._n_wrong += int(np.count_nonzero(columns["return"] > columns["returns"]))
        if self._n_of_sample < _OF_FILE:
            step = max(1, len(chunk) // _OF_CHUNK)
            self._sample.append(np.column_stack([values[::step] for values in raw]).astype(np.int64))
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
        found = [
            *self._of_range(),
            *self._of_steps(raw),
            *self._of_shape(points),
            *self._of_elevations(points),
            *self._of_columns(),
        ]
        return [Remark(code, f"{self._label}: {text}") for code, text in found]

    def _of_range(self) -> Iterator[tuple[str, str]]:
        for axis in np.flatnonzero(self._n_at_limit):
            number = int(self._n_at_limit[axis])
            yield (
                "integer_limit",
                f"{_AXES[axis]} of {number:,} points is the limit of the file's integers: they were written "
                "with a wrong offset or scale",
            )
        if self._n_beyond:
            yield "beyond_limits", f"{self._n_beyond:,} points are noise: {BEYOND}"

    def _of_steps(self, raw: NDArray[np.int64]) -> Iterator[tuple[str, str]]:
        extent = ((self._high.astype(float) - self._low) * self._scales * self._units)[:2]
        if not extent.all():
            return
        spacing = float(np.sqrt(extent.prod() / self._n))
        steps = [int(np.gcd.reduce(column - column[0])) for column in raw.T] * self._scales * self._units
        coarse = [k for k in range(3) if steps[k] > _FINE * spacing]
        if coarse:
            names = " and ".join(_AXES[k] for k in coarse)
            yield (
                "coarse_steps",
                f"{names} have steps of {steps[coarse].max():.3g} m, where points are {spacing:.2g} m apart: "
                "export again with a finer scale",
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

    def _of_elevations(self, points: NDArray[np.float64]) -> Iterator[tuple[str, str]]:
        low, middle, high = np.quantile(points[:, 2], [1.0 - _NEARLY_ALL, 0.5, _NEARLY_ALL])
        share = np.count_nonzero(points[:, 2] > high + _ALOFT) / len(points)
        if not _LOWEST <= middle <= _HIGHEST:
            yield (
                "odd_elevations",
                f"elevations of {low:,.0f} to {high:,.0f} m are of no land: another unit, flying altitudes?",
            )
        elif share:
            yield (
                "aloft",
                f"{share:.1%} of the points lie more than {_ALOFT:.0f} m above nearly all others: clouds, or "
                "positions of the aircraft?",
            )
        for axis in (1, 0):
            if _is_up(points, axis):
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
    """Return what the first points of a cloud tell, so many; InputError if they cannot be read."""
    doubts = CloudDoubts(cloud)
    for chunk in cloud.chunks(n_points, last=min(n_points, cloud.point_count)):
        doubts.add(chunk)
    return doubts.remarks()
