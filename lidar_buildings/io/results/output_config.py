"""What is written: what the model writer's parameters and the command line share."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import ClassVar

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import fixed
from lidar_buildings.core.stages.terrain.config import RasterConfig

#: The format of what has a place on the earth.
TILES = "3dtiles"
#: Layers of buildings, in one file or in one each.
LAYERS = ("outlines", "traced", "roof_faces", "roof_lines")
#: Format of the files that tell of buildings → their names; `building_files` has a writer for each.
FORMAT_FILES = {
    "gpkg": ("buildings.gpkg",),
    "cityjson": ("city_model.city.jsonl",),
    "obj": ("city_model.obj", "city_model.mtl"),
    "dxf": ("city_model.dxf",),
    TILES: ("tiles3d",),
    "flatgeobuf": tuple(f"{layer}.fgb" for layer in LAYERS),
    "geoparquet": tuple(f"{layer}.parquet" for layer in LAYERS),
}
#: The page that tells of a whole result; it is made of the other files.
REPORT, REPORT_FILE = "report", "report.html"
FORMATS = (*FORMAT_FILES, REPORT)
#: Written unless others are chosen; these hold what GeoPackage does.
_DEFAULT_FORMATS = tuple(one for one in FORMATS if one not in ("flatgeobuf", "geoparquet"))


@dataclass(frozen=True)
class OutputConfig(RasterConfig):
    """Which files are made, and what they hold."""

    stage: ClassVar[str] = RasterConfig.stage

    formats: tuple[str, ...] = fixed(
        _DEFAULT_FORMATS,
        "Formats of the files that tell of buildings, and the page to look at; fewer take less time "
        "and room.",
        choices=FORMATS,
    )
    max_buildings_per_file: int = fixed(
        20_000,
        "Buildings above which they are written in blocks, squares of at most as many each, with an index; "
        "raising it gives fewer, larger files and takes more memory.",
        within=(1, 100_000_000),
        advanced=True,
    )
    terrain_tolerance: float = fixed(
        0.2,
        "Height by which the triangles of the terrain in city models may be off the raster of the ground; "
        "raising it makes files smaller, 0 leaves the terrain out.",
        unit="m",
        within=(0.0, 100.0),
        advanced=True,
    )
    geoid_height: float = fixed(
        0.0,
        "Height of the geoid above the ellipsoid of WGS 84, which 3D Tiles stand on: added to elevations "
        "where no grid of PROJ turns them into ellipsoidal heights.",
        unit="m",
        within=(-200.0, 200.0),
        advanced=True,
    )

    copc: bool = fixed(
        False,
        "Whether each classified cloud is written a second time, as COPC: in the order of an octree, for "
        "viewers that show any part at any detail.",
        advanced=True,
    )

    def __post_init__(self) -> None:
        """Check every value, and whether what a format needs is installed."""
        super().__post_init__()
        if "geoparquet" in self.formats and find_spec("pyarrow") is None:
            raise ParameterError(
                f"{self.stage}.formats = {list(self.formats)}: geoparquet needs pyarrow: install "
                "lidar_buildings[parquet], or take flatgeobuf"
            )
