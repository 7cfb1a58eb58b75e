"""The files that tell of a survey's buildings, written side by side in one pass over the buildings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.files.atomic_files import atomic_file, writing
from lidar_buildings.io.models.cityjson import header_line, terrain_line
from lidar_buildings.io.models.dxf import dxf_file
from lidar_buildings.io.models.obj import obj_file
from lidar_buildings.io.models.survey_building import SurveyBuilding, TerrainMesh
from lidar_buildings.io.models.tiles3d import EarthFrame, NoPlaceError, tiles3d_folder
from lidar_buildings.io.results.building_layers import (
    building_layers_file,
    flatgeobuf_files,
    geoparquet_files,
)
from lidar_buildings.io.results.output_config import FORMAT_FILES, TILES, OutputConfig
from lidar_buildings.io.results.run_folder import output_names
from lidar_buildings.io.results.survey_buildings import SurveyBuildings

#: Formats that tell of outlines, also where there are no models.
OF_OUTLINES = ("gpkg", "flatgeobuf", "geoparquet")
_NO_FEATURE = "unknown"


class ModelHeading(NamedTuple):
    """What a city model says of itself."""

    title: str = ""
    crs: str = ""  #: the reference system together with the vertical one, where that is known
    earth: EarthFrame | None = None  #: where the map frame lies on the earth, where that is known


_Add = Callable[[SurveyBuilding | TerrainMesh], None]


def model_heading(
    inputs: Sequence[InputFile], frame: MapFrame, crs: str, files: OutputConfig
) -> tuple[ModelHeading, list[str]]:
    """Return what a survey's city model says of itself, and why a format cannot be made that is wanted."""
    names = output_names(inputs)
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    title = f"Buildings of {names[0]}{more}" if names else ""
    heading = ModelHeading(title, crs)
    if TILES not in files.formats:
        return heading, []
    try:
        earth = EarthFrame(frame, crs, files.geoid_height)
    except NoPlaceError as error:
        why = (
            f"no 3D Tiles were made: {error}: give one (--crs), or leave {TILES} out of model_writer.formats"
        )
        return heading, [why]
    return heading._replace(earth=earth), []


def write_buildings(
    folder: Path,
    buildings: SurveyBuildings,
    formats: Collection[str],
    heading: ModelHeading,
    terrain: Iterable[TerrainMesh] = (),
) -> tuple[list[str], dict[str, int]]:
    """
    Write buildings in some of `FORMAT_FILES`; a file appears, complete, when its last building is written.

    `terrain` stands behind the buildings in every format of models. Returned are the names of the files, and
    status → number of buildings; of those with an outline, where there are any outlines. OutputError if a
    file cannot be written.
    """
    # 3D Tiles stand on the earth, or nowhere
    chosen = [name for name in FORMAT_FILES if name in formats and (heading.earth or name != TILES)]
    paths = [folder / FORMAT_FILES[name][0] for name in chosen]
    outlined: Counter[str] = Counter()
    traced: Counter[str] = Counter()
    with ExitStack() as stack:
        # what is opened last ends first: layers are written at their end, where a disk may be found full
        opened = [
            stack.enter_context(_WRITERS[name](path, buildings, heading))
            for name, path in zip(reversed(chosen), reversed(paths), strict=True)
        ]
        writers = opened[::-1]
        for building in buildings:
            _add_to_all(paths, writers, building)
            status = building.attributes.get("status") or _NO_FEATURE
            outlined[status] += building.outline is not None
            traced[status] += building.traced is not None
        if set(chosen) - set(OF_OUTLINES):
            for mesh in terrain:
                _add_to_all(paths, writers, mesh)
    counted = outlined if outlined.total() else traced
    files = [file for name in chosen for file in FORMAT_FILES[name]]
    return files, dict(sorted((+counted).items()))


def _add_to_all(paths: list[Path], writers: list[_Add], one: SurveyBuilding | TerrainMesh) -> None:
    for path, add in zip(paths, writers, strict=True):
        with writing(path):  # else the file opened last would be named
            add(one)


@contextmanager
def _sequence(path: Path, buildings: SurveyBuildings, heading: ModelHeading) -> Iterator[_Add]:
    header = header_line(buildings.frame, crs=heading.crs, extent=buildings.extent, title=heading.title)
    with atomic_file(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.write(f"{header}\n")

        def add(building: SurveyBuilding | TerrainMesh) -> None:
            line = terrain_line(building) if isinstance(building, TerrainMesh) else building.line
            if line:
                file.write(f"{line}\n")

        yield add


#: Format → what opens its first file for a survey's buildings.
_WRITERS: dict[str, Callable[[Path, SurveyBuildings, ModelHeading], AbstractContextManager[_Add]]] = {
    "gpkg": lambda path, buildings, _: building_layers_file(path, buildings.frame),
    "cityjson": _sequence,
    "obj": lambda path, buildings, _: obj_file(path, buildings.frame),
    "dxf": lambda path, buildings, _: dxf_file(path, buildings.frame),
    TILES: lambda path, _, heading: tiles3d_folder(path, heading.earth),
    "flatgeobuf": lambda path, buildings, _: flatgeobuf_files(path.parent, buildings.frame),
    "geoparquet": lambda path, buildings, _: geoparquet_files(path.parent, buildings.frame),
}
