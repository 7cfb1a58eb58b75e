"""Settings of the segmentation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import SMALLEST_BUILDING, StageConfig, advanced, parameter


@dataclass(frozen=True)
class SegmentationConfig(StageConfig):
    """Settings of the moving-window region growing."""

    stage: ClassVar[str] = "segmentation"

    window: float = parameter(
        4.5,
        "Sides of the moving window, in spacings along and across the scan lines; raising it bridges wider "
        "gaps in a roof and joins closer neighbours.",
        unit="spacings",
        within=(2.0, 20.0),
    )
    min_line_ratio: float = advanced(
        1.5,
        "Ratio of the spacings along and across scan lines from which windows are laid along them; raising "
        "it lays fewer, 1, as published, all.",
        within=(1.0, 40.0),
    )
    min_points: int = advanced(
        10, "Fewest points of a building; raising it drops more of the small clusters.", within=(1, None)
    )
    min_area: float = parameter(
        SMALLEST_BUILDING / 2.0,
        "Smallest area of a building, measured from its number of points; raising it drops more sheds.",
        unit="m²",
        within=(0.0, None),
    )
    min_neck: float = advanced(
        2.5,
        "Width of a neck of points below which the buildings on its ends are two; raising it cuts wider "
        "ones, 0 cuts none, as published.",
        unit="spacings",
        within=(0.0, 4.0),
    )
    split_at_steps: bool = parameter(
        False, "Whether buildings that touch at different heights are split at their step edges."
    )
    min_step_height: float = advanced(
        1.0,
        "Height of a step from which it parts buildings; raising it leaves more of them in one.",
        unit="m",
        within=(0.1, 100.0),
    )


#: As Sampath and Shan (2007) describe it: a window slightly larger than two spacings, and a least
#: number of points, of which they do not say how many.
AS_PUBLISHED = SegmentationConfig(window=2.2, min_line_ratio=1.0, min_area=0.0, min_neck=0.0)
