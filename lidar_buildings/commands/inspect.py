"""The command ``lidar-buildings inspect``: what files and bags hold, and what a run would make of them."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import CLASS_NAMES
from lidar_buildings.core.model.errors import ExitStatus, InputError, printable
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.core.neighbours.point_spacing import surface_spacings
from lidar_buildings.io.bags.bag_inputs import is_bag, is_bag_file, is_point_file
from lidar_buildings.io.clouds.agreement import about_system, in_true_units
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.doubts import CloudDoubts
from lidar_buildings.io.clouds.find_inputs import is_cloud_file, named_by, others_within
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.clouds.point_columns import last_returns, point_columns, xyz_of
from lidar_buildings.io.files.failures import log_to_terminal
from lidar_buildings.io.files.locations import located
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.tiling.survey_spacing import expected_spacing, sample_square
from lidar_buildings.io.tiling.survey_views import SurveyViews
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.io.tiling.tile_stamps import WEEK, stamp_of_time
from lidar_buildings.io.tiling.tiling_config import VIEWS

if TYPE_CHECKING:
    from lidar_buildings.io.bags.bag_summary import BagSummary


#: What views are called in words.
_PLACES = {"above": "above", "street": "the street"}
#: How far about the middle spacings on surfaces are measured [m], and at how many points.
_NEAR_MIDDLE, _PROBES = 30.0, 2_000


@dataclass
class CloudSummary:
    """A cloud at a glance."""

    path: str
    format: str = ""  #: ``LAS 1.4, point format 6, LAZ``
    crs: str = ""  #: reference system, empty if the file does not say
    units: list[float] = field(default_factory=lambda: [1.0, 1.0])  #: metres per unit of x and y, and of z
    #: Pulses are counted by their last returns.
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
    #: From where strips were seen (``above``, ``street``) → strips, by the hour where one number has several.
    views: dict[str, int] = field(default_factory=dict)
    #: Of what was seen from the street the spacings on surfaces, in space: the tenth percentile, the median
    #: and the ninetieth [m].
    surface_spacings: list[float] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)  #: what can hardly be so

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
    (cloud,) = in_true_units([cloud], cloud.crs.name)
    found = CloudSummary(
        str(path), _format_of(cloud), cloud.crs.name, [float(one) for one in cloud.units[1:]]
    )
    if (area := Rectangle.of_cloud(cloud)) is None:
        return found
    found.n_points = cloud.point_count
    found.mins, found.maxs = cloud.mins.tolist(), cloud.maxs.tolist()
    returns, classes, strips, sample, times = Counter[int](), Counter[int](), set[int](), [], []
    square, doubts, survey = sample_square(area), CloudDoubts(cloud), SurveyViews()
    for chunk in cloud.chunks():
        doubts.add(chunk)
        points, columns = xyz_of(chunk) * cloud.units, point_columns(chunk)
        pulses = last_returns(points, columns["return_number"], columns["number_of_returns"])
        found.n_pulses += len(pulses)
        survey.count(0, points, columns, area)
        found.n_withheld += int(np.count_nonzero(chunk.withheld))
        sample.append(pulses[square.holds(pulses[:, 0], pulses[:, 1])])
        returns.update(_occurrences(columns["number_of_returns"]))
        classes.update(_occurrences(np.asarray(chunk.classification)))
        strips.update(np.unique(columns["point_source_id"]).tolist())
        known = columns["gps_time"][np.isfinite(columns["gps_time"])]
        times += [known.min(), known.max()] if known.any() else []
    found.remarks = [*cloud.remarks, *about_system([cloud]), *doubts.remarks()]
    found.n_strips = len(strips)
    views = survey.learn(0)
    found.views = {name: n for name, view in VIEWS.items() if (n := list(views.values()).count(view))}
    if "street" in found.views:
        found.surface_spacings = _on_surfaces(np.concatenate(sample))
    found.returns, found.classes = dict(sorted(returns.items())), dict(sorted(classes.items()))
    found.times = [_time(cloud, one) for one in ((min(times), max(times)) if times else ())]
    spacing = expected_spacing(sample)
    if spacing is not None:
        found.density, found.density_from = spacing**-2, "spacing"
    elif found.area:
        found.density, found.density_from = found.n_pulses / found.area, "bounds"
    found.point_spacing = found.density**-0.5 if found.density else 0.0
    return found


def _on_surfaces(points: NDArray[np.float64]) -> list[float]:
    """Return the spacings on surfaces about the middle of some points [m]."""
    if not len(points):
        return []
    near = (np.abs(points - np.median(points, axis=0))[:, :2] <= _NEAR_MIDDLE).all(axis=1)
    spacings = surface_spacings(points.compress(near, axis=0), _PROBES)
    return [float(one) for one in np.percentile(spacings, (10, 50, 90))] if len(spacings) else []


def _occurrences(values: NDArray[Any]) -> dict[int, int]:
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


def inspect_command(options: argparse.Namespace) -> int:
    """Print what every input holds; return 0, or 2 if one could not be read to its end, said on stderr."""
    log_to_terminal()
    problems: list[str] = []
    told: list[dict[str, Any]] = []
    for name in options.input:
        for kind, summary, lines in _looked_at(name, problems):
            if options.json:
                told.append({"kind": kind, **summary})
            else:
                print("\n".join(lines), flush=True)
    if options.json:
        print(json.dumps(told, indent=2))
    for problem in problems:
        print(f"lidar-buildings: {problem}", file=sys.stderr)
    return ExitStatus.WRONG_USE if problems else ExitStatus.DONE


def _looked_at(name: str, problems: list[str]) -> Iterator[tuple[str, dict[str, Any], list[str]]]:
    try:
        files = _named(located(name))
    except InputError as error:
        problems.append(str(error))
        return
    for file in files:
        try:
            if is_point_file(file):
                cloud = _of_points(file)
                yield "cloud", asdict(cloud), cloud_lines(cloud)
            elif is_bag(file):
                from lidar_buildings.io.bags.bag_summary import summarise_bag  # takes time to import

                bag = summarise_bag(file)
                taken = None if bag.taken is None else bag.taken._asdict()
                topics = [one._asdict() for one in bag.topics]
                yield "bag", {**bag._asdict(), "topics": topics, "taken": taken}, bag_lines(bag)
            else:
                cloud = summarise_cloud(file)
                yield "cloud", asdict(cloud), cloud_lines(cloud)
        except InputError as error:
            problems.append(str(error))


def _of_points(path: Path) -> CloudSummary:
    """Summarise a file that a run makes LAZ of."""
    from lidar_buildings.io.bags.point_files import write_points  # takes time to import

    with tempfile.TemporaryDirectory() as folder:
        write_points(path, Path(folder) / "points.laz")
        cloud = summarise_cloud(Path(folder) / "points.laz")
    cloud.path, cloud.format = str(path), path.suffix[1:].upper()
    return cloud


def _named(path: Path) -> list[Path]:
    within = [path] if is_bag(path) else named_by(path)
    kinds = is_cloud_file, is_bag_file, is_bag
    found = sorted(one for one in within if one == path or any(is_kind(one) for is_kind in kinds))
    if not found:
        raise InputError(
            others_within(path)
            or f"{path}: no point cloud (.las, .laz) and no bag is there: give another folder, or files"
        )
    return found


def cloud_lines(found: CloudSummary) -> list[str]:
    """Return the block of a cloud."""
    path = printable(found.path)
    lines = [f"{path}: {found.format}, {counted(found.n_points, 'point')}"]
    remarks = [f"  {'look':8} {one.text.removeprefix(f'{path}: ')}" for one in found.remarks]
    if not found.n_points:
        return [*lines, *remarks]
    system = found.crs.split(",")[0] or "none in the file"
    units = (
        "" if found.units == [1.0, 1.0] else f" (units of {found.units[0]:g} m, heights {found.units[1]:g} m)"
    )
    is_measured = found.density_from == "spacing"
    measure = "measured in the middle" if is_measured else "pulses by the area of the bounds"
    spans = [f"{low:.2f} to {high:.2f}" for low, high in zip(found.mins, found.maxs, strict=True)]
    width, depth, height = found.size
    rows = {
        "system": f"{system}{units}",
        "extent": f"x {spans[0]}, y {spans[1]}, z {spans[2]}: {width:,.0f} × {depth:,.0f} × {height:,.0f} m",
        "density": f"{found.density:.3g} pulses/m², spacing {found.point_spacing:.2f} m "
        f"({measure}); {counted(found.n_pulses, 'pulse')}"
        if found.density
        else "none: the points span no area",
        "returns": ", ".join(
            f"of {k}: {n:,}" if k else f"not known: {n:,}" for k, n in found.returns.items()
        ),
        "classes": ", ".join(
            f"{CLASS_NAMES.get(number, 'other')} ({number}): {n:,}" for number, n in found.classes.items()
        ),
        "withheld": f"{found.n_withheld:,}" if found.n_withheld else "",
        "times": " to ".join(found.times) or "none",
        "strips": f"{found.n_strips:,}" if found.n_strips else "",
        "seen": _view_words(found),
    }
    return [*lines, *(f"  {name:8} {text}" for name, text in rows.items() if text), *remarks]


def _view_words(found: CloudSummary) -> str:
    """Say from where strips were seen, nothing if from above alone."""
    if "street" not in found.views:
        return ""
    words = ", ".join(f"{counted(n, 'strip')} from {_PLACES[name]}" for name, n in found.views.items())
    if not found.surface_spacings:
        return words
    low, middle, high = found.surface_spacings
    return f"{words}; on surfaces {middle:.3f} m apart in the middle (80 % within {low:.3f} to {high:.3f} m)"


def bag_lines(found: BagSummary) -> list[str]:
    """Return the block of a bag."""
    when = ""
    if found.start is not None:
        moment = datetime.fromtimestamp(found.start // 1_000_000_000, tz=timezone.utc)
        when = f", from {moment:%Y-%m-%d %H:%M:%S} UTC"
    n_messages = sum(one.n_messages for one in found.topics)
    lines = [f"{found.path}: bag of {found.seconds:.1f} s{when}, {counted(n_messages, 'message')}"]
    lines += [f"  {one}" for one in found.topics]
    if found.taken is not None:
        taken = found.taken
        poses = [*filter(None, [taken.odometry]), *taken.transforms]
        lines.append(f"  a run takes: scans {taken.clouds}, poses {', '.join(poses) or 'none'}")
    return lines + [f"  {note}" for note in found.notes]
