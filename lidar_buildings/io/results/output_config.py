"""What is written: what the model writer's parameters and the command line share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import parameter
from lidar_buildings.core.stages.terrain import RasterConfig

#: Format of the files that tell of buildings → their names; `building_files` has a writer for each.
FORMAT_FILES = {
    "gpkg": ("buildings.gpkg",),
    "cityjson": ("city_model.city.jsonl",),
    "obj": ("city_model.obj", "city_model.mtl"),
    "dxf": ("city_model.dxf",),
}
FORMATS = tuple(FORMAT_FILES)


@dataclass(frozen=True)
class OutputConfig(RasterConfig):
    """Which files are made, and what they hold."""

    stage: ClassVar[str] = RasterConfig.stage

    formats: tuple[str, ...] = parameter(
        FORMATS,
        "Formats of the files that tell of buildings; fewer take less time and room.",
        choices=FORMATS,
        read_only=True,
    )
    terrain_tolerance: float = parameter(
        0.2,
        "Height by which the triangles of the terrain in city models may be off the raster of the ground; "
        "raising it makes files smaller, 0 leaves the terrain out.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        read_only=True,
        advanced=True,
    )
