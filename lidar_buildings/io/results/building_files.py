"""The files that tell of a survey's buildings, written side by side in one pass over the buildings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from importlib import import_module
from pathlib import Path

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.files.atomic_files import writing
from lidar_buildings.io.models.survey_building import Add, ModelHeading, SurveyBuilding, TerrainMesh
from lidar_buildings.io.models.tiles3d import EarthFrame, NoPlaceError
from lidar_buildings.io.results.output_config import FORMAT_FILES, OUTPUT_FORMATS, TILES, OutputConfig
from lidar_buildings.io.results.run_folder import output_names
from lidar_buildings.io.results.survey_buildings import SurveyBuildings

_NO_FEATURE = "unknown"


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
        why = f"no 3D Tiles were made: {error}: give one (--crs), or remove {TILES} from model_writer.formats"
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
    Write buildings in some of `OUTPUT_FORMATS`; a file appears, complete, when its last building is written.

    `terrain` stands behind the buildings in every format of models. Returned are the names of the files, and
    status → number of buildings; of those with an outline, where there are any outlines. OutputError if a
    file cannot be written.
    """
    # 3D Tiles stand on the earth, or nowhere
    chosen = [name for name in FORMAT_FILES if name in formats and (heading.earth or name != TILES)]
    heading = heading._replace(frame=buildings.frame, extent=buildings.extent)
    outlined: Counter[str] = Counter()
    traced: Counter[str] = Counter()
    with ExitStack() as stack:
        # what is opened last ends first: layers are written at their end, where a disk may be found full
        paths = {name: folder / FORMAT_FILES[name][0] for name in reversed(chosen)}
        opened = {path: stack.enter_context(writer_of(name)(path, heading)) for name, path in paths.items()}

        def add_to_all(one: SurveyBuilding | TerrainMesh) -> None:
            for path in reversed(opened):
                with writing(path):  # else the file opened last would be named
                    opened[path](one)

        for building in buildings:
            add_to_all(building)
            status = building.attributes.get("status") or _NO_FEATURE
            outlined[status] += building.outline is not None
            traced[status] += building.traced is not None
        if not all(OUTPUT_FORMATS[name].of_outlines for name in chosen):
            for mesh in terrain:
                add_to_all(mesh)
    counted = outlined if outlined.total() else traced
    files = [file for name in chosen for file in FORMAT_FILES[name]]
    return files, dict(sorted((+counted).items()))


def writer_of(name: str) -> Callable[[Path, ModelHeading], AbstractContextManager[Add]]:
    """Import the writer of a format."""
    module, _, function = OUTPUT_FORMATS[name].writer.partition(":")
    writer: Callable[[Path, ModelHeading], AbstractContextManager[Add]]
    writer = getattr(import_module(f"lidar_buildings.io.{module}"), function)
    return writer
