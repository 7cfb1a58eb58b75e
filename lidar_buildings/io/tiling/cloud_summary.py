"""What a LAS, LAZ or COPC file holds, at a glance; and several as one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.clouds.point_columns import last_returns, point_columns, xyz_of
from lidar_buildings.io.tiling.survey_spacing import expected_spacing, sample_square
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.io.tiling.tile_stamps import WEEK, stamp_of_time


@dataclass
class CloudSummary:
    """A cloud at a glance, or several."""

    path: str  #: the file, or folder
    format: str = ""  #: ``LAS 1.4, point format 6, LAZ``
    crs: str = ""  #: reference system, empty if the file does not say
    units: list[float] = field(default_factory=lambda: [1.0, 1.0])  #: metres per unit of x and y, and of z
    #: Pulses are counted by their last returns.
    n_files: int = 1
    n_points: int = 0
    n_pulses: int = 0
    #: Bounds in source coordinates; empty without points.
    mins: list[float] = field(default_factory=list)
    maxs: list[float] = field(default_factory=list)
    #: Pulses a square metre, and 1/√ of it [m]; 0 if there are none.
    density: float = 0.0
    point_spacing: float = 0.0
    #: What it is measured by: ``spacing`` of the pulses in a square of 300 m in the middle, as a run's own
    #: measure, or ``bounds``, where that has too few.
    density_from: str = ""
    #: Number of returns of a point's pulse, and ASPRS class → points.
    returns: dict[int, int] = field(default_factory=dict)
    classes: dict[int, int] = field(default_factory=dict)
    #: First and last GPS time: UTC, or seconds of a week; empty if there are none.
    times: list[str] = field(default_factory=list)
    #: Point source ids; points that the file says are not to be used.
    n_strips: int = 0
    n_withheld: int = 0

    @property
    def size(self) -> NDArray[np.float64]:
        """Width, depth and height [m]."""
        units = np.array([self.units[0], *self.units])
        return (np.array(self.maxs) - self.mins) * units if self.mins else np.zeros(3)

    @property
    def area(self) -> float:
        """Area of the bounds in plan [m²]."""
        return float(self.size[0] * self.size[1])


def summarise_cloud(path: str | Path) -> CloudSummary:
    """Read a file to its last point and sum it up; InputError if it cannot be read."""
    cloud = open_cloud(path)
    found = CloudSummary(
        str(path), _format_of(cloud), cloud.crs.name, [float(one) for one in cloud.units[1:]]
    )
    if (area := Rectangle.of_cloud(cloud)) is None:
        return found
    found.n_points = cloud.point_count
    found.mins, found.maxs = cloud.mins.tolist(), cloud.maxs.tolist()
    returns, classes, strips, sample, times = Counter[int](), Counter[int](), set[int](), [], []
    square = sample_square(area)
    for chunk in cloud.chunks():
        points, columns = xyz_of(chunk) * cloud.units, point_columns(chunk)
        pulses = last_returns(points, columns["return_number"], columns["number_of_returns"])
        found.n_pulses += len(pulses)
        found.n_withheld += int(np.count_nonzero(chunk.withheld))
        sample.append(pulses[square.holds(pulses[:, 0], pulses[:, 1])])
        returns.update(_counts(columns["number_of_returns"]))
        classes.update(_counts(np.asarray(chunk.classification)))
        strips.update(np.unique(columns["point_source_id"]).tolist())
        known = columns["gps_time"][np.isfinite(columns["gps_time"])]
        times += [known.min(), known.max()] if known.any() else []
    found.n_strips = len(strips)
    found.returns, found.classes = dict(sorted(returns.items())), dict(sorted(classes.items()))
    found.times = [_time(cloud, one) for one in ((min(times), max(times)) if times else ())]
    spacing = expected_spacing(sample)
    if spacing is not None:
        found.density, found.density_from = spacing**-2, "spacing"
    elif found.area:
        found.density, found.density_from = found.n_pulses / found.area, "bounds"
    found.point_spacing = found.density**-0.5 if found.density else 0.0
    return found


def summed_up(path: str, parts: Sequence[CloudSummary]) -> CloudSummary:
    """Return several files as one; density is that of the files, by their pulses, and times are left out."""
    filled = [one for one in parts if one.n_points] or list(parts[:1])
    total = CloudSummary(path, n_files=len(parts), units=filled[0].units)
    total.crs = " and ".join(sorted({one.crs or "unknown" for one in filled}))
    total.n_points = sum(one.n_points for one in parts)
    total.n_pulses = sum(one.n_pulses for one in parts)
    total.n_withheld = sum(one.n_withheld for one in parts)
    if filled[0].mins:
        total.mins = np.min([one.mins for one in filled], axis=0).tolist()
        total.maxs = np.max([one.maxs for one in filled], axis=0).tolist()
    total.density = sum(one.density * one.n_pulses for one in parts) / max(total.n_pulses, 1)
    total.point_spacing = total.density**-0.5 if total.density else 0.0
    total.density_from = "files"
    for name in ("returns", "classes"):
        counts = sum((Counter(getattr(one, name)) for one in parts), Counter())
        setattr(total, name, dict(sorted(counts.items())))
    return total


def _counts(values: NDArray[Any]) -> dict[int, int]:
    found, counts = np.unique(values, return_counts=True)
    return dict(zip(found.tolist(), counts.tolist(), strict=True))


def _time(cloud: Cloud, gps_time: float) -> str:
    is_standard = bool(cloud.header.global_encoding.gps_time_type.value)
    stamp = stamp_of_time(gps_time, is_standard=is_standard)
    if stamp is None or (not is_standard and gps_time <= WEEK):
        return f"{gps_time:.1f} s of the week" if 0 <= gps_time <= WEEK else f"{gps_time:.1f}"
    moment = datetime.fromtimestamp(stamp // 1_000_000_000, tz=timezone.utc)
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"


def _format_of(cloud: Cloud) -> str:
    header = cloud.header
    is_copc = any(one.user_id == "copc" for one in header.vlrs)
    packing = "COPC" if is_copc else "LAZ" if header.are_points_compressed else "LAS"
    return f"LAS {header.version}, point format {header.point_format.id}, {packing}"
