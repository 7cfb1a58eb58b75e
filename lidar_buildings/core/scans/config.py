"""How scans are placed in the map: what the assembler's parameters and the command line share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig, fixed
from lidar_buildings.core.scans.point_times import UNITS

if TYPE_CHECKING:
    from lidar_buildings.core.scans.trajectory import Pose

#: A feed that loses more of its points needs a look.
MOST_LOST = 0.05
_WORDS = {3: "three", 6: "six"}


@dataclass(frozen=True)
class ScanConfig(StageConfig):
    """How scans are placed in the map."""

    stage: ClassVar[str] = "scan_assembler"
    #: In a node that places bags beside what else it does.
    is_of_node: ClassVar[bool] = True

    georeferenced: bool = fixed(
        False,
        "Whether scans are taken as they are, their coordinates being the map's; no pose is looked for then.",
    )
    map_frame: str = fixed(
        "map",
        "Frame in which scans are placed; if nobody tells of it, the last one on the way up from the scan's.",
        advanced=True,
    )
    mounting: str = fixed(
        "",
        "Where the scanner is fixed in the frame that poses are of: x, y, z [m], roll, pitch, yaw [deg], "
        "with commas between them (lever arm and boresight); empty if /tf_static tells, or it is that frame.",
    )
    antenna: str = fixed(
        "",
        "Where the antenna of satellite positions (fix) is in the frame that poses are of: x, y, z [m], with "
        "commas between them; empty: at its origin.",
        advanced=True,
    )
    time_unit: str = fixed(
        "auto", "Unit of the points' own times; auto finds it out.", choices=("auto", *UNITS), advanced=True
    )
    max_pose_gap: float = fixed(
        0.5,
        "Longest time between two poses that is filled, or three times their usual step if that is longer; "
        "raising it places more points, and worse.",
        unit="s",
        within=(0.0, 60.0),
        advanced=True,
    )
    max_speed: float = fixed(
        150.0,
        "Highest speed of the sensor; between poses that are further apart no point is placed.",
        unit="m/s",
        within=(0.1, 10_000.0),
        advanced=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.mounting_pose()
        self.antenna_place()

    def mounting_pose(self) -> Pose | None:
        """Return where the scanner is fixed, None if that is not given."""
        if not self.mounting.strip():
            return None
        numbers = self._numbers("mounting", "x, y, z [m], roll, pitch, yaw [deg]")
        # Here, for most runs have no use for what takes long to import.
        from scipy.spatial.transform import Rotation

        from lidar_buildings.core.scans.trajectory import Pose

        # roll, pitch and yaw about fixed axes, as in URDF (REP-103)
        quaternion = Rotation.from_euler("xyz", numbers[3:], degrees=True).as_quat()
        x, y, z, w = (float(part) for part in quaternion)
        return Pose((numbers[0], numbers[1], numbers[2]), (x, y, z, w))

    def antenna_place(self) -> tuple[float, float, float]:
        """Return where the antenna is in the frame that poses are of [m]."""
        if not self.antenna.strip():
            return 0.0, 0.0, 0.0
        x, y, z = self._numbers("antenna", "x, y, z [m]")
        return x, y, z

    def _numbers(self, name: str, wanted: str) -> list[float]:
        """Return the numbers that a parameter lists, as many as are wanted by name."""
        words, n_wanted = getattr(self, name), len(wanted.split(","))
        try:
            numbers = [float(word) for word in words.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) != n_wanted or not np.isfinite(numbers).all():
            raise ParameterError(
                f"{self.stage}.{name} = {words!r}: must be {_WORDS[n_wanted]} numbers with commas between "
                f"them: {wanted}"
            )
        return numbers
