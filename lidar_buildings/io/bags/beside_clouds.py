"""Placed points of a bag laid beside the clouds of other inputs: by systems, an offset, or their surfaces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
import pyproj
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.surfaces.alignment import MIN_GROUND, Alignment, align, height_offset
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.clouds.agreement import agreed_system
from lidar_buildings.io.clouds.cloud import Cloud, laz_backend
from lidar_buildings.io.clouds.las import chunks_within, open_cloud
from lidar_buildings.io.clouds.point_columns import xyz_of
from lidar_buildings.io.files.atomic_files import atomic_file

#: Points of the bag that are compared, about.
_SAMPLE = 2_000_000
#: Points lie within this of a bag's to be compared with them [m].
_AROUND = 5.0
#: Side of the square amid the bag in which heights are compared where nothing is aligned [m].
_SQUARE = 100.0
#: Heights that differ by more are told of, and clouds of which the ground still differs by more are not taken
#: for aligned [m].
_LOOK, _MOST_RMS = 0.3, 0.3
#: A bag farther from the files is in another system than it says [m].
_FAR = 1_000.0
#: The origin of a file that is written anew is rounded to this.
_STEP = 100.0


class Beside(NamedTuple):
    """How a bag's points lie beside those of other inputs, as ``run.json`` tells it."""

    said: str  #: one line
    warning: str = ""  #: what is doubtful, empty if nothing is
    alignment: dict[str, float] | None = None  #: how they were moved, and what residuals are left


def lay_beside(bag: Path, path: Path, clouds: Sequence[Cloud], choice: BagConfig) -> Beside:
    """
    Move the points of a bag, a LAZ file, to the clouds beside which they are used; the file is written anew.

    Points come into the clouds' reference system: from the one that the bag's poses name, or by the offset
    that is given. InputError if nothing says how, they are not near the clouds, or cannot be aligned.
    """
    placed, first = (
        open_cloud(path),
        agreed_system([cloud for cloud in clouds if cloud.point_count] or clouds),
    )
    if not placed.point_count or not first.point_count:
        return Beside("")
    if choice.offset.strip() or first.crs.name not in ("", placed.crs.name):
        _rewrite(path, placed, _way(placed, first, choice.offset), first.crs.name)
        placed = open_cloud(path)
    frame = MapFrame(placed.crs.name, (0.0, 0.0, 0.0), *placed.units[1:].tolist())
    filled = [cloud for cloud in clouds if cloud.point_count]
    gap = min(_gap(cloud, placed) for cloud in filled)
    if gap > _FAR:
        where = f"its points lie {gap / 1000.0:,.1f} km from those of the files"
        raise InputError(f"{bag}: {where}: say where its frame is in their system with --offset X,Y,Z,YAW")
    near = [cloud for cloud in filled if _gap(cloud, placed) <= 0.0]
    if not near and not choice.align:
        return Beside("")
    street = _sample(placed, frame)
    middle = np.median(street, axis=0)
    if not choice.align:
        is_amid = (np.abs(street - middle)[:, :2] <= _SQUARE / 2.0).all(axis=1)
        return _compared(street[is_amid], _points_near(near, frame, street[is_amid]))
    above = _points_near(near, frame, street)
    found = align(street - middle, above - middle)
    if found is None or found.rms_ground > _MOST_RMS:
        why = (
            "they share no ground"
            if found is None
            else f"on ground they differ by {found.rms_ground:.2f} m (RMS)"
        )
        raise InputError(f"{bag}: cannot be aligned to the files: {why}: place it with --offset X,Y,Z,YAW")
    _rewrite(path, placed, _mover(found, middle, frame), placed.crs.name)
    return _aligned(found)


def offset_of(text: str) -> NDArray[np.float64]:
    """Return x, y, z [m] and yaw [deg] of an offset; ParameterError if they are not four numbers."""
    try:
        numbers = np.array([float(word) for word in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise ParameterError(
            f"{BagConfig.stage}.offset = {text!r}: must be four numbers with commas between them: x, y, z "
            "[m], yaw [deg]"
        )
    return numbers


def _way(placed: Cloud, first: Any, offset: str) -> Any:
    """Return what leads from a bag's coordinates to those of the files."""
    if offset.strip():
        *shift, yaw = offset_of(offset).tolist()
        cosine, sine = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return lambda points: (points * placed.units @ turn + shift) / first.units
    if not placed.crs.name:
        return lambda points: points * placed.units / first.units
    transformer = pyproj.Transformer.from_crs(placed.crs.name, first.crs.name, always_xy=True)

    def transformed(points: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = transformer.transform(points[:, 0], points[:, 1])
        return np.column_stack([x, y, points[:, 2] * placed.units[2] / first.units[2]])

    return transformed


def _mover(found: Alignment, middle: NDArray[np.float64], frame: MapFrame) -> Any:
    return lambda points: frame.to_source(found.moved(frame.to_map(points) - middle) + middle)


def _aligned(found: Alignment) -> Beside:
    x, y, z = found.shift.tolist()
    known = {
        "x": x,
        "y": y,
        "z": z,
        "yaw_deg": math.degrees(found.yaw),
        "rms_ground": found.rms_ground,
        "n_ground": found.n_ground,
    }
    said = (
        f"aligned to the files: moved by {x:+.3f}, {y:+.3f}, {z:+.3f} m, turned by {known['yaw_deg']:+.3f}°"
    )
    left = f"left are {found.rms_ground:.3f} m on ground and roofs ({found.n_ground:,} points, RMS)"
    if math.isinf(found.plan_error):
        return Beside(
            f"{said}; {left}", "too few walls show in both to align them in plan: only heights are", known
        )
    known |= {"rms_walls": found.rms_walls, "n_walls": found.n_walls, "plan_error": found.plan_error}
    walls = f"{found.rms_walls:.3f} m on walls ({found.n_walls:,}); in plan ± {found.plan_error:.3f} m"
    return Beside(f"{said}; {left}, {walls}", alignment=known)


def _compared(street: NDArray[np.float64], above: NDArray[np.float64]) -> Beside:
    rise, scatter, n_cells = height_offset(street, above) if len(street) and len(above) else (0.0, 0.0, 0)
    if n_cells < MIN_GROUND:
        return Beside("beside the files: too little ground shows in both to compare heights")
    how = f"median of {n_cells:,} m², ± {scatter:.2f} m"
    said = f"its ground lies {-rise:+.2f} m above that of the files ({how})"
    if abs(rise) <= _LOOK:
        return Beside(said)
    return Beside("", f"{said}: heights of another system? --align lays it on them")


def _gap(cloud: Cloud, placed: Cloud) -> float:
    """Return how far apart the bounds of two clouds are in plan [m]."""
    apart = np.maximum(cloud.mins - placed.maxs, placed.mins - cloud.maxs)[:2] * placed.units[:2]
    return float(np.hypot(*np.maximum(apart, 0.0)))


def _sample(placed: Cloud, frame: MapFrame) -> NDArray[np.float64]:
    step = math.ceil(placed.point_count / _SAMPLE)
    return frame.to_map(np.concatenate([xyz_of(chunk)[::step] for chunk in placed.chunks()]))


def _points_near(
    clouds: Sequence[Cloud], frame: MapFrame, street: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the points of clouds within the bounds of others [m]."""
    if not len(street):
        return street
    low, high = (street[:, :2].min(axis=0) - _AROUND), (street[:, :2].max(axis=0) + _AROUND)
    bounds = (*(low / frame.horizontal_unit), *(high / frame.horizontal_unit))
    parts = [frame.to_map(xyz_of(chunk)) for cloud in clouds for _, chunk in chunks_within(cloud, bounds)]
    return np.concatenate([np.empty((0, 3)), *parts])


def _rewrite(path: Path, placed: Cloud, way: Any, crs: str) -> None:
    """Write a file's points anew where a function of their coordinates says, with a reference system."""
    own = placed.header
    header = laspy.LasHeader(point_format=own.point_format.id, version="1.4")
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams(one.name, one.type_str(), one.description)
            for one in own.point_format.extra_dimensions
        ]
    )
    middle = way(((placed.mins + placed.maxs) / 2.0)[None])[0]
    header.scales, header.offsets = own.scales, np.floor(middle / _STEP) * _STEP
    header.global_encoding.gps_time_type = own.global_encoding.gps_time_type
    header.system_identifier, header.generating_software = own.system_identifier, own.generating_software
    if crs:
        header.add_crs(pyproj.CRS(crs))
    with atomic_file(path) as temporary, open(temporary, "wb") as stream:
        writer = laspy.LasWriter(stream, header, do_compress=True, laz_backend=laz_backend(), closefd=False)
        for chunk in placed.chunks():
            record = laspy.ScaleAwarePointRecord.zeros(len(chunk), header=header)
            for name in chunk.array.dtype.names or ():
                if name not in ("X", "Y", "Z"):
                    record.array[name] = chunk.array[name]
            record.x, record.y, record.z = way(xyz_of(chunk)).T
            writer.write_points(record)
        writer.close()
