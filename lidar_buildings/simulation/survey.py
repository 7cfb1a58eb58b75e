"""A virtual survey: to files, or to a tile in memory."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.files.atomic_files import atomic_file, writing
from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.config import SimulationConfig
from lidar_buildings.simulation.las_strips import strip_file
from lidar_buildings.simulation.named_scenes import make_scene
from lidar_buildings.simulation.scanner import DEFAULTS, joined, scan
from lidar_buildings.simulation.scene import VirtualScene
from lidar_buildings.simulation.truth_city_model import write_truth_city_model
from lidar_buildings.simulation.truth_layers import write_truth_layers

#: Names of the files of a survey.
STRIP_NAME, LAYERS_NAME, CITY_MODEL_NAME = "strip_{:02d}.laz", "truth.gpkg", "truth.city.jsonl"


@dataclass(frozen=True)
class SurveySummary:
    """What a virtual survey gave."""

    files: tuple[Path, ...]  #: the strips' LAZ files
    truth_files: tuple[Path, ...]  #: GeoPackage and CityJSONSeq
    n_points: int
    n_buildings: int
    seconds: float  #: wall time [s]


@dataclass(frozen=True, eq=False)
class TileTruth:
    """What is true of a tile's points, row by row."""

    scene: VirtualScene  #: what was measured; `scene.buildings` in map coordinates
    classification: NDArray[np.uint8]  #: ASPRS classes
    building: NDArray[np.uint32]  #: number of the building, 0 = none
    plane: NDArray[np.uint16]  #: roof face from 1; 0 = none, façades too

    @property
    def buildings(self) -> tuple[Building, ...]:
        """The scene's buildings."""
        return self.scene.buildings


def simulate_survey(
    output: Path | str,
    scene: str = "village",
    seed: int = 0,
    config: SimulationConfig = DEFAULTS,
    **parameters: Any,
) -> SurveySummary:
    """
    Fly over a scene and write what was measured and what is true; the same seed gives the same bytes.

    A LAZ file per strip, and the truth as GeoPackage and CityJSONSeq; those of an earlier survey in the same
    folder are replaced, its surplus strips removed. `parameters` replace members of `config`, such as
    ``density=20``. ParameterError if the scene or a parameter is unknown or out of range, OutputError if the
    folder or a file cannot be written.
    """
    begin = time.perf_counter()
    virtual, config, output = make_scene(scene, seed), _replaced(config, parameters), Path(output)
    make_folder(output)
    files, n_points = [], 0
    for strip in scan(virtual, seed, config):
        files.append(output / STRIP_NAME.format(len(files) + 1))
        with strip_file(files[-1], virtual.frame) as add:
            add(strip)
        n_points += len(strip.points)
    truth_files = write_truth(output, virtual)
    remove_surplus(output, files)
    seconds = time.perf_counter() - begin
    return SurveySummary(tuple(files), truth_files, n_points, len(virtual.buildings), seconds)


def write_truth(output: Path, scene: VirtualScene) -> tuple[Path, Path]:
    """Write what is true of a scene into a folder; return the GeoPackage and the CityJSONSeq."""
    layers, model = output / LAYERS_NAME, output / CITY_MODEL_NAME
    write_truth_layers(layers, scene)
    with atomic_file(model) as part:
        write_truth_city_model(part, scene)
    return layers, model


def simulate_tile(
    scene: str | VirtualScene = "single_house",
    seed: int = 0,
    config: SimulationConfig = DEFAULTS,
    **parameters: Any,
) -> tuple[PointTile, TileTruth]:
    """
    Fly over a scene, by name or one's own, and return all points as one tile, with what is true of them.
    """
    virtual = scene if isinstance(scene, VirtualScene) else make_scene(scene, seed)
    measured = joined(list(scan(virtual, seed, _replaced(config, parameters))))
    n_points = len(measured.points)
    tile = PointTile(
        points=measured.points,
        intensity=measured.intensity,
        return_number=measured.return_number,
        number_of_returns=measured.number_of_returns,
        classification=np.full(n_points, int(PointClass.UNCLASSIFIED)),
        scan_angle=measured.scan_angle,
        point_source_id=measured.point_source_id,
        gps_time=measured.gps_time,
        buffer=np.zeros(n_points),
        source=np.zeros(n_points),
        index=np.arange(n_points),
        stamp=int(measured.gps_time[0] * 1e9) if n_points else 0,
        frame=virtual.frame,
    )
    return tile, TileTruth(virtual, measured.true_class, measured.true_building, measured.true_plane)


def _replaced(config: SimulationConfig, parameters: dict[str, Any]) -> SimulationConfig:
    known = [member.name for member in fields(config)]
    for name in parameters:
        if name not in known:
            raise ParameterError(f"simulation.{name}: unknown parameter, must be one of {', '.join(known)}")
    return replace(config, **parameters)


def make_folder(folder: Path) -> None:
    """Make the folder of a survey unless it is there."""
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)


def remove_surplus(output: Path, files: list[Path]) -> None:
    """Remove the strips that an earlier survey with more strips left."""
    for path in output.iterdir():
        if re.fullmatch(r"strip_\d{2,}\.laz", path.name) and path not in files:
            path.unlink()
