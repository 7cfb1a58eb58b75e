"""The rasters' parameters."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig, fixed


@dataclass(frozen=True)
class RasterConfig(StageConfig):
    """
    Parameters of `make_rasters`.

    They are parameters of the node that makes the rasters, and carry its name.
    """

    stage: ClassVar[str] = "model_writer"

    raster_resolution: float = fixed(
        0.5,
        "Side of a cell of the rasters of ground and surface; a larger one gives smaller files and less "
        "detail, 0 gives no rasters.",
        unit="m",
        within=(0.0, 100.0),
    )
    raster_reach: float = fixed(
        20.0,
        "Radius of the smallest circle without any point that stays unknown in the rasters; a larger one "
        "closes wider waters and gaps, and wants a buffer three times as wide.",
        unit="m",
        within=(0.0, 200.0),
        advanced=True,
    )
    dtm_interpolation: str = fixed(
        "linear",
        "How the ground is closed under buildings and in gaps: in the triangles of the points around, by "
        "natural neighbours (wants the extra `terrain`), inverse distances, a thin-plate spline, or ordinary "
        "kriging, which also gives the variance of the DTM.",
        choices=("linear", "natural_neighbour", "idw", "spline", "kriging"),
        advanced=True,
    )

    def __post_init__(self) -> None:
        """Refuse natural neighbours where the library is not installed."""
        super().__post_init__()
        if self.dtm_interpolation == "natural_neighbour" and not importlib.util.find_spec("startinpy"):
            raise ParameterError(
                f"{self.stage}.dtm_interpolation = 'natural_neighbour': needs startinpy: "
                "pip install '.[terrain]' in the sources"
            )
