"""The parameters of the virtual survey."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, parameter


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
    pattern: str = parameter(
        "zigzag",
        "Scan lines to and fro (oscillating mirror) or all one way (rotating polygon).",
        choices=("zigzag", "parallel"),
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
