"""What ``lidar-buildings inspect`` prints of a cloud and of a bag."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timezone
from typing import TYPE_CHECKING

from lidar_buildings.commands.progress import counted
from lidar_buildings.core.model.classes import PointClass

if TYPE_CHECKING:
    from lidar_buildings.io.bags.bag_summary import BagSummary
    from lidar_buildings.io.tiling.cloud_summary import CloudSummary

#: How a density was measured, in words.
_MEASURES = {
    "spacing": "measured in the middle",
    "bounds": "pulses by the area of the bounds",
    "files": "mean of the files",
}
_NAMES = {one.value: one.name.lower().replace("_", " ") for one in PointClass}


def cloud_lines(found: CloudSummary) -> list[str]:
    """Return the block of a cloud, or of several."""
    head = found.format or counted(found.n_files, "file")
    lines = [f"{found.path}: {head}, {counted(found.n_points, 'point')}"]
    if not found.n_points:
        return lines
    system = found.crs.split(",")[0] or "none in the file"
    units = (
        "" if found.units == [1.0, 1.0] else f" (units of {found.units[0]:g} m, heights {found.units[1]:g} m)"
    )
    rows = {
        "system": f"{system}{units}",
        "extent": _extent(found),
        "density": f"{found.density:.3g} pulses/m², spacing {found.point_spacing:.2f} m "
        f"({_MEASURES[found.density_from]}); {counted(found.n_pulses, 'pulse')}"
        if found.density
        else "none: the points span no area",
        "returns": _counts(found.returns, {0: "not known"}, "of "),
        "classes": _counts(found.classes, _NAMES, ""),
        "withheld": f"{found.n_withheld:,}" if found.n_withheld else "",
        "times": " to ".join(found.times) or ("" if found.n_files > 1 else "none"),
        "strips": f"{found.n_strips:,}" if found.n_strips else "",
        "refused": found.refused,
    }
    return [*lines, *(f"  {name:8} {text}" for name, text in rows.items() if text)]


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


def _extent(found: CloudSummary) -> str:
    spans = [f"{low:.2f} to {high:.2f}" for low, high in zip(found.mins, found.maxs, strict=True)]
    width, depth, height = found.size
    return f"x {spans[0]}, y {spans[1]}, z {spans[2]}: {width:,.0f} × {depth:,.0f} × {height:,.0f} m"


def _counts(counts: Mapping[int, int], names: Mapping[int, str], before: str) -> str:
    return ", ".join(
        f"{names.get(number, f'{before}{number}' if before else 'other')}"
        f"{f' ({number})' if not before else ''}: {n:,}"
        for number, n in counts.items()
    )
