"""The parameters of the virtual survey and its flight plan: parallel strips that cover the scene."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import ClassVar

import numpy as np
import shapely

from lidar_buildings.core.model.parameters import StageConfig, parameter
from lidar_buildings.simulation.scene import VirtualScene


@dataclass(frozen=True)
class SimulationConfig(StageConfig):
    """How the virtual scanner flies and measures."""

    stage: ClassVar[str] = "simulation"

    density: float = parameter(
        8.0,
        "Mean density of pulses over the scene, all strips together; raising it gives more points.",
        unit="1/m²",
        within=(0.05, 200.0),
    )
    altitude: float = parameter(
        300.0,
        "Flying height above the mean terrain; raising it widens the strips and the beam's footprint.",
        unit="m",
        within=(100.0, 5000.0),
    )
    ground_speed: float = parameter(
        50.0, "Speed over ground; raising it shortens the strips' duration.", unit="m/s", within=(1.0, 200.0)
    )
    flight_direction_deg: float = parameter(
        0.0,
        "Direction of the first strip, counter-clockwise from east; every other strip is flown back.",
        unit="deg",
        within=(-360.0, 360.0),
    )
    max_scan_angle_deg: float = parameter(
        20.0,
        "Largest scan angle; raising it widens the strips and shows more of the façades.",
        unit="deg",
        within=(1.0, 35.0),
    )
    overlap: float = parameter(
        0.3,
        "Share of a strip's width that its neighbour covers too; raising it gives more strips.",
        within=(0.0, 0.9),
    )
    range_noise: float = parameter(
        0.03,
        "Standard deviation along the beam; raising it roughens all surfaces.",
        unit="m",
        within=(0.0, 1.0),
    )
    planimetric_noise: float = parameter(
        0.03, "Standard deviation along x and along y; raising it blurs edges.", unit="m", within=(0.0, 2.0)
    )
    beam_divergence_mrad: float = parameter(
        0.4,
        "Full divergence of the beam; raising it gives more pulses with two returns at eaves. 0 = none.",
        unit="mrad",
        within=(0.0, 5.0),
    )
    gross_error_share: float = parameter(
        5e-5,
        "Share of pulses that measure a point far below the ground or high in the air.",
        within=(0.0, 0.1),
    )


#: The day of every survey: files must not depend on the day they are made.
SURVEY_DATE = date(2024, 5, 6)
#: Adjusted standard GPS time (GPS seconds less 10⁹) at take-off: that day, 9 h [s].
TAKE_OFF = 1_399_021_218.0 - 1e9
#: Time for a turn between two strips [s].
TURN = 120.0
#: Scan lines go on this far beyond the scene at the strips' ends [m].
RUN_IN = 5.0


@dataclass(frozen=True)
class Strip:
    """One straight flight."""

    number: int  #: the point source id, from 1
    start: tuple[float, float, float]  #: position of the first pulse [m]
    heading: tuple[float, float]  #: unit vector of flight
    speed: float  #: [m/s]
    start_time: float  #: adjusted standard GPS time [s]
    pulse_rate: float  #: [1/s]
    n_lines: int  #: scan lines
    pulses_per_line: int

    @property
    def n_pulses(self) -> int:
        """Pulses in the whole strip."""
        return self.n_lines * self.pulses_per_line

    @property
    def duration(self) -> float:
        """From the first pulse to the last [s]."""
        return self.n_pulses / self.pulse_rate


def plan_flight(scene: VirtualScene, config: SimulationConfig) -> tuple[Strip, ...]:
    """Lay strips over the scene that cover every place, with the mean density that is asked for."""
    angle = np.deg2rad(config.flight_direction_deg)
    heading = np.array([np.cos(angle), np.sin(angle)])
    left = np.array([-heading[1], heading[0]])
    middle = np.array(scene.size) / 2
    corners = np.array([(0, 0), (scene.size[0], 0), scene.size, (0, scene.size[1])]) - middle
    half_length = np.ptp(corners @ heading) / 2 + RUN_IN
    swath = 2 * config.altitude * np.tan(np.deg2rad(config.max_scan_angle_deg))
    spacing = swath * (1 - config.overlap)
    n_strips = 1 + max(0, int(np.ceil((float(np.ptp(corners @ left)) - swath) / spacing)))
    centres = [middle + spacing * (row - (n_strips - 1) / 2) * left for row in range(n_strips)]
    axes = [(centre - half_length * heading, centre + half_length * heading) for centre in centres]
    area = shapely.box(0, 0, *scene.size)
    covered = [
        shapely.LineString(axis).buffer(swath / 2, cap_style="flat").intersection(area).area for axis in axes
    ]
    density = config.density * area.area / sum(covered)  # of one strip: where strips overlap there is more
    altitude = float(scene.terrain.at(middle[None])[0]) + config.altitude
    # scan lines are as far apart as the pulses within them
    pulses_per_line = max(2, round(swath * np.sqrt(density)))
    strips: list[Strip] = []
    for start, end in axes:
        if len(strips) % 2:
            start, end = end, start
        length = float(np.hypot(*(end - start)))
        last = strips[-1] if strips else None
        strips.append(
            Strip(
                number=len(strips) + 1,
                start=(float(start[0]), float(start[1]), altitude),
                heading=tuple((end - start) / length),
                speed=config.ground_speed,
                start_time=last.start_time + last.duration + TURN if last else TAKE_OFF,
                pulse_rate=config.ground_speed * density * swath,
                n_lines=max(1, round(length * density * swath / pulses_per_line)),
                pulses_per_line=pulses_per_line,
            )
        )
    return tuple(strips)
