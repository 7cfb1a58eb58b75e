"""What a feed's folder holds beside the points: where the map lies, and the points as LAZ files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.neighbours.cell_grid import cell_numbers
from lidar_buildings.core.neighbours.point_spacing import rounded_spacing
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.clouds.las_records import read_raw_header
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.tiling.live_survey import POINTS_PER_FILE, LiveSurvey
from lidar_buildings.io.tiling.map_place import Geodetic, LevelFrame, MapPlace, moved_origin
from lidar_buildings.io.tiling.placed_laz import PlacedLaz
from lidar_buildings.io.tiling.spool import RECORD, records_of
from lidar_buildings.io.tiling.survey_spacing import expected_spacing, pulses_of
from lidar_buildings.io.tiling.tile_grid import BUFFER_SHARES
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig

#: Time of a feed whose points tell these [s].
PERIOD = 2.0
#: A place is left behind when so long before the period's end no point fell into it [s]: an airborne scanner
#: passes over it once, one on the street comes back to it with each turn.
_LEFT = 0.5
#: Side of a place [m].
_PLACE = 5.0
#: Points that one strip is to bring into a tile with its buffer; further strips and those across bring more.
_STRIP_POINTS = 600_000
#: Sides to choose from are multiples of the step, between the smallest and the largest [m]. Smaller tiles are
#: mostly buffer, and a scanner on the street goes on measuring what it has measured.
_SMALLEST, _LARGEST, _STEP = 150.0, 1000.0, 25.0
_SECOND = 1e9


class FeedScale(NamedTuple):
    """What holds for all tiles of a feed."""

    side: float  #: of tiles [m]
    #: The point spacing that tiles are expected to have [m]; None: nothing tells, and each has its own.
    spacing: float | None


def scale_of(scans: Sequence[PlacedScan], buffer: float, *, is_end: bool = False) -> FeedScale | None:
    """
    Choose the side of tiles, and measure their spacing; None as long as too little has come.

    Both by what the scanner has left behind in the first `PERIOD`. One that goes on measuring what it has
    measured tells no spacing: its tiles become denser than what it shows in a short time. `buffer` is the
    width of the strip of neighbours east of a tile [m]; at the end nothing more is waited for.
    """
    times = np.concatenate([scan.times for scan in scans])
    end = times[0] + round(PERIOD * _SECOND)
    if not is_end and times.max() < end:
        return None
    is_early = times <= end
    xy = np.concatenate([scan.points[:, :2] for scan in scans])[is_early]
    is_left, area = _left_behind(xy, times[is_early])
    if 2 * np.count_nonzero(is_left) < len(xy):
        return FeedScale(_SMALLEST, None)
    around = buffer * (BUFFER_SHARES[0] + BUFFER_SHARES[2])
    widest = math.sqrt(_STRIP_POINTS * area / np.count_nonzero(is_left)) - around
    side = min(max(math.floor(widest / _STEP) * _STEP, _SMALLEST), _LARGEST)
    pulses = pulses_of(np.concatenate([records_of(scan) for scan in scans])[is_early][is_left])
    spacing = expected_spacing([pulses])
    return FeedScale(side, None if spacing is None else rounded_spacing(spacing))


def _left_behind(xy: NDArray[np.float64], times: NDArray[np.int64]) -> tuple[NDArray[np.bool_], float]:
    """Tell which points lie in places left behind, and the area of these [m²]."""
    places, place = np.unique(cell_numbers(xy, _PLACE), return_inverse=True)
    last = np.full(len(places), np.iinfo(np.int64).min)
    np.maximum.at(last, place, times)
    is_left = last < times.max() - round(_LEFT * _SECOND)
    return is_left[place], float(np.count_nonzero(is_left) * _PLACE**2)


#: Folder with the LAZ files.
CLOUDS = "clouds"
_NAME = "points_{:05d}.laz"
_SURVEY = "survey.json"
#: What a LAZ file holds of points beside their coordinates.
_COLUMNS = [name for name in RECORD.names or () if name not in ("x", "y", "z", "source", "index")]


class Recorded(NamedTuple):
    """What a feed must know to go on."""

    scale: FeedScale  #: side and point spacing of tiles
    given: MapPlace
    frame: MapFrame  #: the frame of tiles: the map's, with an origin near them
    target: str = ""  #: the frame in which poses place scans, empty in a feed that goes on

    @classmethod
    def beginning(cls, scale: FeedScale, given: MapPlace, scan: PlacedScan, target: str) -> Recorded:
        """Return what a feed knows whose first points are a scan's, as placed by its poses."""
        return cls(scale, given, moved_origin(given.frame, given.placed(scan).points[0]), target)

    def where_target_lies(self, frame: str) -> str:
        """Say where the frame of the poses lies in that of tiles, of a name; nothing if they are the same."""
        points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
        (x, y, z), (east, north, _) = self.placed(
            PlacedScan(points, np.zeros(2, np.int64), {})
        ).points.tolist()
        yaw = math.atan2(north - y, east - x)
        where = f"--x {x:.3f} --y {y:.3f} --z {z:.3f} --yaw {yaw:.6f}"
        here = f"topics are in frame {frame}" + ", which is of the grid" * bool(self.frame.crs)
        if self.target not in ("", frame):
            return (
                f"{here}; for TF: ros2 run tf2_ros static_transform_publisher {where} --frame-id {frame} "
                f"--child-frame-id {self.target}"
            )
        if not self.target or not any((x, y, z, yaw)):
            return ""
        return (
            f"{here}, not the {frame} of the poses, which lies in it at {where}; rename the frame of the "
            "poses, or publish map_origin if its axes are those of a grid"
        )

    def placed(self, scan: PlacedScan) -> PlacedScan:
        """Return a scan as placed by its poses in the frame of tiles."""
        shift = np.array(self.frame.origin) - np.array(self.given.frame.origin)
        way = self.given.placed(PlacedScan(scan.way, np.zeros(len(scan.way), np.int64), {}))
        scan = self.given.placed(scan)
        return scan._replace(points=scan.points - shift, way=way.points - shift)


def record(folder: Path, tiling: LiveTilingConfig, recorded: Recorded) -> None:
    """Note what a feed must know to go on; OutputError if it cannot be written."""
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_file(folder / _SURVEY) as temporary:
        frames = {"given": asdict(recorded.given.frame), "frame": asdict(recorded.frame)}
        level = recorded.given.level
        frames["level"] = None if level is None else level.origin._asdict() | {"yaw": level.yaw}
        temporary.write_text(json.dumps(_identity(tiling) | recorded.scale._asdict() | frames))


def recorded_of(folder: Path, tiling: LiveTilingConfig) -> Recorded | None:
    """Return what `record` has noted, None if nothing; OutputError if the folder is of other tiles."""
    try:
        noted = json.loads((folder / _SURVEY).read_text())
        own = {name: noted[name] for name in _identity(tiling)}
        spacing = noted["spacing"]
        scale = FeedScale(float(noted["side"]), None if spacing is None else float(spacing))
        given, level = _frame_of(noted["given"]), noted["level"]
        yaw = level.pop("yaw", 0.0) if level else 0.0  # a feed of earlier versions has none
        place = MapPlace(given, level and LevelFrame(Geodetic(**level), given.crs, yaw))
        recorded = Recorded(scale, place, _frame_of(noted["frame"]))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise OutputError(f"{folder / _SURVEY}: cannot be read ({error}): remove the folder") from error
    if own != _identity(tiling):
        raise OutputError(
            f"{folder}: contains points tiled with {own}, not {_identity(tiling)}: give the same "
            "parameters, or another folder as scan_assembler.spool"
        )
    return recorded


def write_placed_points(survey: LiveSurvey, folder: Path) -> Iterator[int]:
    """
    Write all points of a feed as LAZ files, file k those of source k, but for those that were full before.

    Yields how many are left, before each and at the end: who asks for no more leaves the rest for the next
    time. OutputError if one cannot be written.
    """
    (folder / CLOUDS).mkdir(exist_ok=True)
    n_files = -(-survey.n_points // POINTS_PER_FILE)
    for number in range(n_files):
        path = folder / CLOUDS / _NAME.format(number)
        yield n_files - number
        is_full = (number + 1) * POINTS_PER_FILE <= survey.n_points
        if is_full and path.exists() and read_raw_header(path).point_count == POINTS_PER_FILE:
            continue
        with atomic_file(path) as temporary:
            file = PlacedLaz(temporary)
            try:
                file.place(survey.frame)
                for records in survey.records(number):
                    points = np.column_stack([records[axis] for axis in "xyz"]).astype(np.float64)
                    columns = {name: records[name] for name in _COLUMNS}
                    file.add(PlacedScan(points, np.zeros(len(points), np.int64), columns))
            finally:
                file.close()
    yield 0


def _identity(tiling: LiveTilingConfig) -> dict[str, float]:
    """Return what the tiles of a folder have in common, and its points: so many bytes each."""
    own = {name: getattr(tiling, name) for name in ("tile_size", "buffer", "max_buffer")}
    return own | {"bytes_a_point": RECORD.itemsize}


def _frame_of(noted: dict[str, Any]) -> MapFrame:
    return MapFrame(**noted | {"origin": tuple(noted["origin"])})
