"""
Points of a feed placed where they were measured: over gaps in chains of poses, and wrong times of points.

    python -m bench.scans.run

A scanner moves along x at 10 m/s for thirty steps of its slow link. First table: `map` to `odom` comes at a
rate and lacks some poses in a row; `odom` to `lidar` comes at 50 Hz. Second: a share of the points in every
third scan has a wrong time. Of the points with a right time it says how many are placed within 0.02 m, and
how far off the worst is that is placed; with a wrong time how many are left out.
"""

from __future__ import annotations

from contextlib import suppress
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.common.tables import table
from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.scans.cloud_layout import members_of_fields
from lidar_buildings.core.scans.placing import ScanPlacer

_SECOND, _BEGIN = 1_000_000_000, 1_700_000_000
_SPEED, _SLOW = 10.0, 0.5
_N_POINTS, _LENGTH = 200, 0.1
_RIGHT = 0.02
RATES, GAPS = (0.2, 1.0, 5.0, 20.0), (0, 1, 2, 3, 5, 10)
SHARES = (0.005, 0.01, 0.05, 0.1, 0.2)
#: Driver → (type of its times, their unit [s], whether they are since 1970).
DRIVERS = {
    "float s": ("<f4", 1.0, False),
    "uint32 ns": ("<u4", 1e-9, False),
    "uint32 us": ("<u4", 1e-6, False),
    "float64 s since 1970": ("<f8", 1.0, True),
}
#: How a time is wrong.
WRONG = {"zero": 0.0, "+ 0.3 s": 0.3, "+ 1e6 s": 1e6, "- 4 s": -4.0}


class Found(NamedTuple):
    """What became of points."""

    right: float  #: share of those with a right time that are placed within `_RIGHT`
    worst: float  #: how far the others of these are off that are placed [m]
    left_out: float  #: share of those with a wrong time that are left out


def chain(rate: float, gap: int) -> Found:
    """Place the points of a chain of frames whose slow link lacks some poses."""
    step = 1.0 / rate
    slow = [k * step for k in range(31) if not 15 < k <= 15 + gap]
    return _placed(slow, 30.0 * step, *DRIVERS["uint32 ns"])


def wrong_times(driver: str, share: float, by: float) -> Found:
    """Place points of which some in every third scan have a wrong time."""
    return _placed(list(np.arange(0.0, 12.0, 0.5)), 10.0, *DRIVERS[driver], share, by)


def _placed(
    slow: list[float],
    end: float,
    kind: str,
    unit: float,
    is_absolute: bool,
    share: float = 0.0,
    by: float = 0.0,
) -> Found:
    random, placer = np.random.default_rng(0), ScanPlacer()
    fast = np.arange(0.0, end + 0.02, max(0.02, end / 2000))
    events = [(second, ("map", "odom"), _SLOW) for second in slow]
    events += [(second, ("odom", "lidar"), _SPEED) for second in fast]
    scans = np.arange(0.0, end - 2 * _LENGTH, max(_LENGTH, end / 100))
    events += [(second + _LENGTH, None, 0.0) for second in scans]
    found: list[Any] = []
    is_wrong: list[NDArray[np.bool_]] = []
    for second, edge, speed in sorted(events, key=lambda one: one[0]):
        if edge is not None:
            placer.add_transforms(transform_of(second, *edge, speed * second), is_static=False)
        else:
            begin = second - _LENGTH
            since = np.linspace(0.0, _LENGTH * 0.99, _N_POINTS)
            bad = random.random(_N_POINTS) < (share if len(is_wrong) % 3 == 0 else 0.0)
            # y names the point, z says when it was measured
            number = len(is_wrong) * _N_POINTS + np.arange(_N_POINTS)
            is_wrong.append(bad)
            told = np.where(bad, by if by else -begin * is_absolute, since) + is_absolute * (_BEGIN + begin)
            if bad.any() and not by:
                told[bad] = 0.0
            values = np.clip(told / unit, *_limits(kind)).astype(kind)
            x = -(_SPEED + _SLOW) * (begin + since)
            with suppress(MessageError):
                placer.add_scan(scan_of(begin, np.column_stack([x, number + 1.0]), values))
        found += placer.placed()
    found += placer.placed(is_end=True)
    rows = np.concatenate([one.points for one in found]) if found else np.zeros((0, 3))
    wrong, number = np.concatenate(is_wrong), np.rint(rows[:, 1]).astype(int) - 1
    off = np.abs(rows[~wrong[number], 0])
    n_wrong = max(int(wrong.sum()), 1)
    return Found(
        float(np.count_nonzero(off <= _RIGHT) / np.count_nonzero(~wrong)),
        float(off.max(initial=0.0)),
        1.0 - np.count_nonzero(wrong[number]) / n_wrong if wrong.any() else 0.0,
    )


def _limits(kind: str) -> tuple[float, float]:
    return (0.0, 2.0**32 - 1024) if np.dtype(kind).kind == "u" else (-1e30, 1e30)


def _header(second: float, frame: str) -> Any:
    stamp = _BEGIN * _SECOND + round(second * _SECOND)
    return SimpleNamespace(
        stamp=SimpleNamespace(sec=stamp // _SECOND, nanosec=stamp % _SECOND), frame_id=frame
    )


def transform_of(second: float, parent: str, child: str, x: float) -> Any:
    """Return a message of one transform: a frame that lies along x in its parent."""
    move = SimpleNamespace(
        translation=SimpleNamespace(x=x, y=0.0, z=0.0), rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    )
    one = SimpleNamespace(header=_header(second, parent), child_frame_id=child, transform=move)
    return SimpleNamespace(transforms=[one])


def scan_of(second: float, xy: NDArray[np.float64], times: NDArray[Any]) -> Any:
    """Return a cloud of the frame `lidar` at z = 0."""
    rows = np.zeros(len(xy), [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("t", times.dtype.str)])
    rows["x"], rows["y"], rows["t"] = xy[:, 0], xy[:, 1], times
    return SimpleNamespace(
        header=_header(second, "lidar"),
        height=1,
        width=len(rows),
        fields=[SimpleNamespace(**one) for one in members_of_fields(rows.dtype)],
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.nbytes,
        data=rows.tobytes(),
        is_dense=True,
    )


def main() -> None:
    """Print both tables."""
    print("share of the points placed right, by rate of the slow link and poses that it lacks in a row\n")
    rows = [[f"{rate:g} Hz", *(f"{chain(rate, gap).right:.3f}" for gap in GAPS)] for rate in RATES]
    print(table(["", *map(str, GAPS)], rows))
    print("\nright times: share placed right, worst [m]; wrong times: share left out\n")
    rows = []
    for driver in DRIVERS:
        for name, by in WRONG.items():
            cells = [wrong_times(driver, share, by) for share in SHARES]
            rows.append([driver, name, *(f"{c.right:.3f}, {c.worst:.2f}; {c.left_out:.2f}" for c in cells)])
    print(table(["driver", "wrong", *(f"{share:.1%}" for share in SHARES)], rows))


if __name__ == "__main__":
    main()
