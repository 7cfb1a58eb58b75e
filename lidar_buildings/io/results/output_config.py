"""What is written: what the model writer's parameters and the command line share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from lidar_buildings.core.model.parameters import fixed
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.io.clouds.find_inputs import InputConfig
from lidar_buildings.io.models.other_names import OTHER_NAMES, OWN


class OutputFormat(NamedTuple):
    """A format of the files that hold buildings."""

    files: tuple[str, ...]
    #: ``module:function`` below `io`: with the path of the first file and a `ModelHeading` it opens a context
    #: that gives a function, which adds a `SurveyBuilding` or a `TerrainMesh`.
    writer: str
    is_default: bool = True
    of_outlines: bool = False  #: written without models, too, and holds no terrain


#: The one format whose files have a place on the earth.
TILES = "3dtiles"
#: Layers of buildings, in one file or in one each.
LAYERS = ("outlines", "traced", "roof_faces", "roof_lines", "roof_corners")
#: Those of what was seen from the street, which are there only where something was.
STREET_LAYERS = ("facades", "street_lines")
_BY_LAYER = "results.building_layers"
#: The one declaration of each format: its name in `formats`, files and writer.
OUTPUT_FORMATS = {
    "gpkg": OutputFormat(("buildings.gpkg",), f"{_BY_LAYER}:building_layers_file", of_outlines=True),
    "cityjson": OutputFormat(
        ("city_model.city.jsonl", "city_model.city.json"), "models.cityjson:cityjson_file"
    ),
    "obj": OutputFormat(("city_model.obj", "city_model.mtl"), "models.obj:obj_file"),
    "dxf": OutputFormat(("city_model.dxf",), "models.dxf:dxf_file"),
    TILES: OutputFormat(("tiles3d",), "models.tiles3d:tiles3d_folder"),
    # holds what GeoPackage does
    "flatgeobuf": OutputFormat(
        tuple(f"{layer}.fgb" for layer in LAYERS),
        f"{_BY_LAYER}:flatgeobuf_files",
        is_default=False,
        of_outlines=True,
    ),
}
FORMAT_FILES = {name: one.files for name, one in OUTPUT_FORMATS.items()}
#: The page about a whole result, made from the other files.
REPORT, REPORT_FILE = "report", "report.html"
_DEFAULT_FORMATS = (*(name for name, one in OUTPUT_FORMATS.items() if one.is_default), REPORT)


@dataclass(frozen=True)
class OutputConfig(RasterConfig):
    """Which files are made, and what they hold."""

    stage: ClassVar[str] = RasterConfig.stage

    formats: tuple[str, ...] = fixed(
        _DEFAULT_FORMATS,
        "Formats of the files that tell of buildings, and the page to look at; fewer take less time "
        "and room.",
        choices=(*OUTPUT_FORMATS, REPORT),
    )
    attributes: str = fixed(
        OWN,
        "Names of another data set under which attributes of buildings stand as well, such as `b3_h_dak_70p` "
        "of 3DBAG.",
        choices=tuple(OTHER_NAMES),
        advanced=True,
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
    geoid_grid: str = fixed(
        "",
        "File with a grid of the geoid's heights above that ellipsoid, GeoTIFF or GTX, or the name of one of "
        "PROJ's; it is taken instead, for all elevations.",
        advanced=True,
    )


@dataclass(frozen=True)
class SurveyConfig(OutputConfig, InputConfig):
    """Which survey is written, and where."""

    input: tuple[str, ...] = fixed(
        (),
        "The same files, folders and globs as of `tile_player`. Empty: the survey is live, the map frame is "
        "that of `map_origin`, and tiles stay on disk when files are made of them.",
        advanced=True,
    )
    placed: str = fixed(
        "",
        "Folder with the clouds that a live source writes of its points (`points_*.laz`), or `tile_player` "
        "of bags, from which the classified ones are made; empty: none are made in a live survey.",
        advanced=True,
    )
    output: str = fixed("", "Folder for the results.")
    overwrite: bool = fixed(False, "Whether to begin anew in a folder with earlier results.", advanced=True)
    until: str = fixed(STAGES[-1], "The last stage that the graph runs.", choices=STAGES, advanced=True)
    settings: str = fixed(
        "",
        "All settings that results depend on, as JSON; an unfinished run goes on only with the same.",
        advanced=True,
    )
    footprints: str = fixed(
        "", "File of the footprints that `building_tracer` was given, empty if none.", advanced=True
    )
    footprints_layer: str = fixed("", "Layer of it; empty: its only one.", advanced=True)
    footprint_id: str = fixed(
        "",
        "Column of the footprints' file that names them in the results; empty: one that looks like it, or "
        "the features' numbers.",
        advanced=True,
    )
