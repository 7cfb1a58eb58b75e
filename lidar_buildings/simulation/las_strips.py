"""Strips as LAZ files: LAS 1.4, point format 6, raw as from a scanner, with the truth in extra dimensions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import laspy
import numpy as np
import pyproj

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.point_columns import SCAN_ANGLE_STEP
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.simulation.flight import SURVEY_DATE
from lidar_buildings.simulation.scanner import StripPoints

#: Resolution of the coordinates [m].
SCALE = 0.001
#: What the writer raises when a file cannot be written.
_FAILURES = (OSError, laspy.errors.LaspyException, RuntimeError)
#: Extra dimension → its type, member of `StripPoints` and description (at most 32 bytes).
TRUTH_DIMENSIONS = {
    "TrueClass": ("uint8", "true_class", "true ASPRS class"),
    "TrueBuilding": ("uint32", "true_building", "number in truth.gpkg, 0 = none"),
    "TruePlane": ("uint16", "true_plane", "roof face in truth.gpkg"),
}


@contextmanager
def strip_file(path: Path, frame: MapFrame) -> Iterator[Callable[[StripPoints], None]]:
    """
    Give a function that writes points of a strip to a file; `classification` is 1 throughout.

    It appears when the block ends well; OutputError if it cannot be written.
    """
    with atomic_file(path, _FAILURES) as part, open(part, "wb") as stream:
        writer = laspy.LasWriter(stream, _header(frame), do_compress=True, closefd=False)

        def add(strip: StripPoints) -> None:
            record = laspy.ScaleAwarePointRecord.zeros(len(strip.points), header=writer.header)
            record.x, record.y, record.z = frame.to_source(strip.points).T
            record.intensity = strip.intensity
            record.return_number = strip.return_number
            record.number_of_returns = strip.number_of_returns
            record.scan_direction_flag = strip.scan_direction
            record.edge_of_flight_line = strip.edge_of_flight_line
            record.classification = np.full(len(strip.points), int(PointClass.UNCLASSIFIED), dtype=np.uint8)
            record.scan_angle = np.round(strip.scan_angle / SCAN_ANGLE_STEP).astype(np.int16)
            record.point_source_id = strip.point_source_id
            record.gps_time = strip.gps_time
            for name, (_, member, _) in TRUTH_DIMENSIONS.items():
                record[name] = getattr(strip, member)
            writer.write_points(record)

        yield add
        writer.close()


def _header(frame: MapFrame) -> laspy.LasHeader:
    """A header without anything that depends on the day or the machine."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, kind, text) for name, (kind, _, text) in TRUTH_DIMENSIONS.items()]
    )
    header.scales = np.full(3, SCALE)
    header.offsets = np.asarray(frame.origin)
    header.add_crs(pyproj.CRS(frame.crs))
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.creation_date = SURVEY_DATE
    header.system_identifier = "virtual scanner"
    header.generating_software = "lidar_buildings simulate"
    return header
