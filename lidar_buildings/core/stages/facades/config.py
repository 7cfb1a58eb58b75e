"""The parameters of the search for façades."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, advanced, parameter


@dataclass(frozen=True)
class FacadesConfig(StageConfig):
    """How façades are found in points seen from the street."""

    stage: ClassVar[str] = "facades"

    min_seen_height: float = parameter(
        1.0,
        "Height of wall that has to be seen; raising it drops façades that hedges or parked cars hide.",
        unit="m",
        within=(0.3, 20.0),
    )
    min_length: float = parameter(
        0.5, "Shortest façade; raising it drops corners and piers.", unit="m", within=(0.3, 100.0)
    )
    max_gap: float = advanced(
        1.0,
        "Widest gap in a façade: windows, doors, what poles and trunks hide; raising it closes gateways.",
        unit="m",
        within=(0.25, 20.0),
    )
    min_confidence: float = parameter(
        0.5,
        "Confidence from which a wall is a façade; raising it drops walls that may be fences, hedges or "
        "vehicles.",
        within=(0.0, 1.0),
    )
