"""A virtual survey: to files, or to a tile in memory; and the command ``lidar-buildings simulate``."""

from __future__ import annotations

import argparse
import re
import time
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import OutputError, ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.clouds.point_columns import SCAN_ANGLE_STEP
from lidar_buildings.io.files.atomic_files import atomic_file, compact_json, writing
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.simulation.building import Building, shell_of
from lidar_buildings.simulation.flight import SURVEY_DATE, SimulationConfig
from lidar_buildings.simulation.named_scenes import make_scene
from lidar_buildings.simulation.scanner import DEFAULTS, StripPoints, joined, scan
from lidar_buildings.simulation.scene import VirtualScene
from lidar_buildings.simulation.truth_layers import SeenParts, building_attributes, write_truth_layers

#: Resolution of the coordinates [m].
SCALE = 0.001
#: What the writer raises when a file cannot be written.
#: The file with the true buildings.
_TRUTH = "truth.gpkg"
_FAILURES = (OSError, laspy.errors.LaspyException, RuntimeError)
#: Extra dimension → its type, member of `StripPoints` and description (at most 32 bytes).
TRUTH_DIMENSIONS = {
    "TrueClass": ("uint8", "true_class", "true ASPRS class"),
    "TrueBuilding": ("uint32", "true_building", "number in truth.gpkg, 0 = none"),
    "TruePlane": ("uint16", "true_plane", "roof face in truth.gpkg"),
}
#: Further ones where buildings have eaves, windows and doors.
DETAIL_DIMENSIONS = {"TrueKind": ("uint8", "true_kind", "what was hit: SurfaceKind")}


class SurveyFiles:
    """
    The files of a survey: a LAZ file for each strip, `classification` 1 throughout, and the truth.

    `files` are the clouds that are begun, and at the end the truth. A file appears when it is complete; what
    an earlier survey left in the folder goes at the end. OutputError if the folder or a file cannot be
    written.
    """

    def __init__(self, output: Path, scene: VirtualScene) -> None:
        self.files: list[Path] = []
        self._output, self._scene, self._seen = output, scene, SeenParts(scene)
        self._dimensions = TRUTH_DIMENSIONS | (DETAIL_DIMENSIONS if scene.is_detailed else {})
        self._strip = 0
        self._file = ExitStack()
        with writing(output):
            output.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> SurveyFiles:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is None or issubclass(kind, KeyboardInterrupt):
            self._file.close()  # of an interrupted survey with what there is
            for path in self._output.iterdir():
                if re.fullmatch(r"strip_\d{2,}\.laz", path.name) and path not in self.files:
                    path.unlink()
            self.files += write_truth(self._output, self._scene, self._seen)
        else:
            self._file.__exit__(kind, *error)

    def add(self, number: int, strip: StripPoints) -> None:
        """Write points of a strip; strips come one after the other."""
        if number != self._strip:
            self._file.close()
            self._strip = number
            path = self._output / f"strip_{number:02d}.laz"
            stream = open(self._file.enter_context(atomic_file(path, _FAILURES)), "wb")  # noqa: SIM115
            self._file.enter_context(stream)
            self._writer = laspy.LasWriter(
                stream, _header(self._scene.frame, self._dimensions), do_compress=True, closefd=False
            )
            self._file.callback(self._writer.close)
            self.files.append(path)
        frame = self._scene.frame
        record = laspy.ScaleAwarePointRecord.zeros(len(strip.points), header=self._writer.header)
        record.x, record.y, record.z = frame.to_source(strip.points).T
        for name in ("intensity", "return_number", "number_of_returns", "edge_of_flight_line"):
            record[name] = getattr(strip, name)
        record.scan_direction_flag = strip.scan_direction
        record.classification = np.full(len(strip.points), int(PointClass.UNCLASSIFIED), dtype=np.uint8)
        record.scan_angle = np.round(strip.scan_angle / SCAN_ANGLE_STEP).astype(np.int16)
        record.point_source_id = strip.point_source_id
        record.gps_time = strip.gps_time
        for name, (_, member, _) in self._dimensions.items():
            record[name] = getattr(strip, member)
        self._writer.write_points(record)
        self._seen.add(strip)


def _header(frame: MapFrame, dimensions: dict[str, tuple[str, str, str]]) -> laspy.LasHeader:
    """A header without anything that depends on the day or the machine."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, kind, text) for name, (kind, _, text) in dimensions.items()]
    )
    header.scales = np.full(3, SCALE)
    header.offsets = np.asarray(frame.origin)
    header.add_crs(pyproj.CRS(frame.crs))
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.creation_date = SURVEY_DATE
    header.system_identifier = "virtual scanner"
    header.generating_software = "lidar_buildings simulate"
    return header


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
    kind: NDArray[np.uint8]  #: `SurfaceKind`


def simulate_survey(
    output: Path | str,
    scene: str = "village",
    seed: int = 0,
    config: SimulationConfig = DEFAULTS,
    *,
    details: bool = False,
    **parameters: Any,
) -> SurveySummary:
    """
    Fly over a scene and write what was measured and what is true; the same seed gives the same bytes.

    A LAZ file per strip, and the truth as GeoPackage and CityJSONSeq; those of an earlier survey in the same
    folder are replaced, its surplus strips removed. `details` as in `make_scene`; `parameters` replace
    members of `config`, such as ``density=20``. ParameterError if the scene or a parameter is unknown or out
    of range, OutputError if the folder or a file cannot be written.
    """
    begin = time.perf_counter()
    virtual, config = make_scene(scene, seed, details=details), _replaced(config, parameters)
    n_points = 0
    with SurveyFiles(Path(output), virtual) as survey:
        for number, strip in enumerate(scan(virtual, seed, config), start=1):
            survey.add(number, strip)
            n_points += len(strip.points)
    seconds = time.perf_counter() - begin
    *files, layers, model = survey.files
    return SurveySummary(tuple(files), (layers, model), n_points, len(virtual.buildings), seconds)


def write_truth(output: Path, scene: VirtualScene, seen: SeenParts | None = None) -> tuple[Path, Path]:
    """Write what is true of a scene, and seen, into a folder; return the GeoPackage and the CityJSONSeq."""
    layers, model = output / _TRUTH, output / "truth.city.jsonl"
    write_truth_layers(layers, scene, seen)
    with atomic_file(model) as part:
        write_truth_city_model(part, scene)
    return layers, model


def simulate_tile(
    scene: str | VirtualScene = "single_house",
    seed: int = 0,
    config: SimulationConfig = DEFAULTS,
    **parameters: Any,
) -> tuple[PointTile, TileTruth]:
    """Fly over a scene, by name or one's own; return all points as one tile, and what is true of them."""
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
    truth = measured.true_class, measured.true_building, measured.true_plane, measured.true_kind
    return tile, TileTruth(virtual, *truth)


def _replaced(config: SimulationConfig, parameters: dict[str, Any]) -> SimulationConfig:
    known = [member.name for member in fields(config)]
    for name in parameters:
        if name not in known:
            raise ParameterError(f"simulation.{name}: unknown parameter, must be one of {', '.join(known)}")
    return replace(config, **parameters)


#: What is wrong where nothing would be made.
NOWHERE = "simulate: nothing says where to: give --output DIR, --live or --bag DIR"


def simulate_command(options: argparse.Namespace) -> int:
    """
    Make a virtual survey and say where it is.

    OutputError if the folder holds something and may not be replaced, or cannot be written; ParameterError if
    there is no such scene, a value is out of range, or the folder is missing.
    """
    if options.output is None:
        raise ParameterError(NOWHERE)
    check_airborne(options)
    check_folder(options.output, options.overwrite)
    parameters: dict[str, Any] = {} if options.density is None else {"density": options.density}
    survey = simulate_survey(
        options.output, options.scene, options.seed, details=options.details, **parameters
    )
    rate = survey.n_points / max(survey.seconds, 1e-9)
    print(
        f"{options.scene}: {counted(survey.n_buildings, 'building')}, {survey.n_points:,} points"
        f" in {survey.seconds:.1f} s ({rate / 1e6:.2f} M points/s)"
    )
    for path in (*survey.files, *survey.truth_files):
        print(f"  {path}")
    return 0


def check_airborne(options: argparse.Namespace) -> None:
    """Refuse options of the vehicle's scanner."""
    given = {
        "--beams": options.beams,
        "--top": options.top,
        "--profile": options.profile or None,
        "--pose-noise": options.pose_noise,
        "--pose-drift": options.pose_drift,
    }
    for name, value in given.items():
        if value is not None:
            raise ParameterError(f"{name} applies only to a vehicle: add --scanner vehicle")


def check_folder(folder: Path, overwrite: bool) -> None:
    """Refuse a folder for a survey that holds something, unless that may be replaced."""
    try:
        is_full = folder.is_dir() and any(folder.iterdir())
    except OSError as error:
        raise OutputError(f"{folder}: {error.strerror}: choose another folder") from error
    if is_full and not overwrite:
        what = "contains a simulated survey already" if (folder / _TRUTH).exists() else "is not empty"
        raise OutputError(f"{folder}: {what}: choose another folder, or add --overwrite to make it anew")


def write_truth_city_model(path: Path, scene: VirtualScene) -> None:
    """Write the header and one feature per building, one JSON text per line."""
    authority, code = scene.frame.crs.split(":")
    header = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [SCALE] * 3, "translate": list(scene.frame.origin)},
        "metadata": {
            "referenceSystem": f"https://www.opengis.net/def/crs/{authority}/0/{code}",
            "referenceDate": SURVEY_DATE.isoformat(),
            "title": f"True buildings of the virtual scene {scene.name}",
        },
        "CityObjects": {},
        "vertices": [],
    }
    texts = [header, *map(_feature, scene.buildings, building_attributes(scene))]
    path.write_text("".join(f"{compact_json(one)}\n" for one in texts), encoding="utf-8")


def _feature(building: Building, attributes: dict[str, Any]) -> dict[str, Any]:
    name = f"building-{building.number}"
    shell = shell_of(building)
    vertices: dict[tuple[int, ...], int] = {}
    boundary = [[_ring(ring, vertices) for ring in surface] for surface in shell.surfaces]
    kinds = [0] * len(shell.roofs) + [1] * len(shell.walls) + [2]
    solid = {
        "type": "Solid",
        "lod": "2.2",
        "boundaries": [boundary],
        "semantics": {
            "surfaces": [{"type": "RoofSurface"}, {"type": "WallSurface"}, {"type": "GroundSurface"}],
            "values": [kinds],
        },
    }
    rounded = {
        key: round(value, 4) if isinstance(value, float) else value for key, value in attributes.items()
    }
    return {
        "type": "CityJSONFeature",
        "id": name,
        "CityObjects": {name: {"type": "Building", "attributes": rounded, "geometry": [solid]}},
        "vertices": [list(vertex) for vertex in vertices],
    }


def _ring(ring: NDArray[np.float64], vertices: dict[tuple[int, ...], int]) -> list[int]:
    rounded = [tuple(int(c) for c in row) for row in np.round(ring / SCALE)]
    return [vertices.setdefault(vertex, len(vertices)) for vertex in rounded]
