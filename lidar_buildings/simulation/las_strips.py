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


def write_strip(path: Path, strip: StripPoints, frame: MapFrame) -> None:
    """Write one strip; `classification` is 1 throughout."""
    las = laspy.LasData(_header(frame))
    las.points = laspy.ScaleAwarePointRecord.zeros(len(strip.points), header=las.header)
    las.xyz = frame.to_source(strip.points)
    las.intensity = strip.intensity
    las.return_number = strip.return_number
    las.number_of_returns = strip.number_of_returns
    las.scan_direction_flag = strip.scan_direction
    las.edge_of_flight_line = strip.edge_of_flight_line
    las.classification = np.full(len(strip.points), int(PointClass.UNCLASSIFIED), dtype=np.uint8)
    las.scan_angle = np.round(strip.scan_angle / ANGLE_UNIT).astype(np.int16)
    las.point_source_id = strip.point_source_id
    las.gps_time = strip.gps_time
    for name, (_, member, _) in TRUTH_DIMENSIONS.items():
        las[name] = getattr(strip, member)
    with open(path, "wb") as stream:
        las.write(stream, do_compress=True)


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
