"""Strips as LAZ files: LAS 1.4, point format 6, raw as from a scanner, with the truth in extra dimensions."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pyproj

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.simulation.flight import SURVEY_DATE
from lidar_buildings.simulation.scanner import StripPoints

#: Resolution of the coordinates [m].
SCALE = 0.001
#: Unit of the scan angle in point format 6 [deg].
ANGLE_UNIT = 0.006
#: Extra dimension → its type, member of `StripPoints` and description (at most 32 bytes).
TRUTH_DIMENSIONS = {
    "TrueClass": ("uint8", "true_class", "true ASPRS class"),
    "TrueBuilding": ("uint32", "true_building", "number in truth.gpkg, 0 = none"),
    "TruePlane": ("uint16", "true_plane", "roof face in truth.gpkg"),
}


class StripFile:
    """
    A strip's file that grows; `classification` is 1 throughout.

    Parameters
    ----------
    path : Path
        The file.
    frame : MapFrame
        Where the scene lies.
    """

    def __init__(self, path: Path, frame: MapFrame) -> None:
        self._frame = frame
        stream = open(path, "wb")  # noqa: SIM115
        self._writer = laspy.LasWriter(stream, _header(frame), do_compress=True, closefd=True)

    def add(self, strip: StripPoints) -> None:
        """Write points."""
        record = laspy.ScaleAwarePointRecord.zeros(len(strip.points), header=self._writer.header)
        record.x, record.y, record.z = self._frame.to_source(strip.points).T
        record.intensity = strip.intensity
        record.return_number = strip.return_number
        record.number_of_returns = strip.number_of_returns
        record.scan_direction_flag = strip.scan_direction
        record.edge_of_flight_line = strip.edge_of_flight_line
        record.classification = np.full(len(strip.points), int(PointClass.UNCLASSIFIED), dtype=np.uint8)
        record.scan_angle = np.round(strip.scan_angle / ANGLE_UNIT).astype(np.int16)
        record.point_source_id = strip.point_source_id
        record.gps_time = strip.gps_time
        for name, (_, member, _) in TRUTH_DIMENSIONS.items():
            record[name] = getattr(strip, member)
        self._writer.write_points(record)

    def close(self) -> None:
        """Complete the file."""
        self._writer.close()


def write_strip(path: Path, strip: StripPoints, frame: MapFrame) -> None:
    """Write one strip."""
    file = StripFile(path, frame)
    try:
        file.add(strip)
    finally:
        file.close()


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
