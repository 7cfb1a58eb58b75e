"""What the files of buildings say of the survey as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.input_file import InputFile
from lidar_buildings.io.models.earth_frame import EarthFrame, NoPlaceError
from lidar_buildings.io.results.output_config import TILES, OutputConfig
from lidar_buildings.io.results.run_folder import output_names
from lidar_buildings.io.results.terrain_files import crs_with_heights


class ModelHeading(NamedTuple):
    """What a city model says of itself."""

    title: str = ""
    crs: str = ""  #: the reference system together with the vertical one, where that is known
    earth: EarthFrame | None = None  #: where the map frame lies on the earth, where that is known


def model_heading(
    inputs: Sequence[InputFile], frame: MapFrame, files: OutputConfig
) -> tuple[ModelHeading, list[str]]:
    """Return what a survey's city model says of itself, and why a format cannot be made that is wanted."""
    names = output_names(inputs)
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    title = f"Buildings of {names[0]}{more}" if names else ""
    heading = ModelHeading(title, crs_with_heights(inputs, frame))
    if TILES not in files.formats:
        return heading, []
    try:
        earth = EarthFrame(frame, heading.crs, files.geoid_height)
    except NoPlaceError as error:
        why = (
            f"no 3D Tiles were made: {error}: give one (--crs), or leave {TILES} out of model_writer.formats"
        )
        return heading, [why]
    return heading._replace(earth=earth), []
