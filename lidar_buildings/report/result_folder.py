"""A result folder as the report reads it: its record, and its buildings in the map frame."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.files.reference_systems import model_frame
from lidar_buildings.io.models.cityjson import load_feature
from lidar_buildings.io.results.building_layers import READABLE_ID
from lidar_buildings.io.results.output_config import FORMAT_FILES
from lidar_buildings.io.results.run_folder import RUN
from lidar_buildings.io.vectors.layers import read_layer

(GPKG,), (CITY_MODEL, _) = FORMAT_FILES["gpkg"], FORMAT_FILES["cityjson"]
_FEATURE = '{"type":"CityJSONFeature","id":"'
_NAME = re.compile(re.escape(_FEATURE) + r'([^"]*)"')
#: What pieces of terrain are called, which are no buildings.
_TERRAIN = "terrain-"


@dataclass(frozen=True, eq=False)
class ReportedBuilding:
    """A building of a result."""

    name: str  #: its readable id
    #: As the files have them, in their unit of length; None where a value is missing.
    attributes: dict[str, Any]
    #: After and before regularisation, map frame [m]; None where the result has no such layer.
    outline: shapely.Polygon | None = None
    traced: shapely.Polygon | None = None

    @property
    def building_id(self) -> int:
        """The number that points carry."""
        return int(self.attributes.get("building_id") or 0)

    @property
    def shape(self) -> shapely.Polygon | None:
        """The outline, or the traced ring where the run ended before."""
        return self.traced if self.outline is None else self.outline

    @property
    def status(self) -> str:
        """One word; a run that ended before there were models gives none."""
        return self.attributes.get("status") or "unknown"

    @property
    def quality(self) -> str:
        """The grade; empty where there are no models."""
        return self.attributes.get("quality") or ""

    @property
    def quality_reasons(self) -> str:
        """What speaks against the building, empty if nothing does."""
        return self.attributes.get("quality_reasons") or ""


@dataclass(frozen=True, eq=False)
class Result:
    """What a folder holds."""

    folder: Path
    run: dict[str, Any]  #: the content of ``run.json``
    frame: MapFrame  #: of all coordinates here

    @property
    def unit(self) -> float:
        """Metres in the unit of length of the buildings' attributes."""
        return model_frame(self.frame).vertical_unit

    @cached_property
    def buildings(self) -> list[ReportedBuilding]:
        """The buildings by id: of the layers, or of the city model where there are no layers."""
        if self.has(GPKG):
            return list(_of_layers(self.folder / GPKG, self.frame))
        features = [load_feature(line)[0] for line in self.lines()]
        return [ReportedBuilding(one["id"], one["CityObjects"][one["id"]]["attributes"]) for one in features]

    def lines(self, names: Collection[str] | None = None) -> Iterator[str]:
        """Yield the CityJSONFeatures of buildings, of all or of some; InputError if they cannot be read."""
        if not self.has(CITY_MODEL):
            return
        try:
            with open(self.folder / CITY_MODEL, encoding="utf-8") as file:
                for line in file:
                    found = _NAME.match(line)
                    if found is None or found[1].startswith(_TERRAIN):
                        continue
                    if names is None or found[1] in names:
                        yield line
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{self.folder / CITY_MODEL}: cannot be read ({error}): run it again") from error

    def has(self, name: str) -> bool:
        """Whether the run made this file, and it is there."""
        return name in self.run.get("files", ()) and (self.folder / name).is_file()

    def clouds(self) -> list[Path]:
        """Return the classified clouds that hold points."""
        inputs = [one for one in self.run.get("inputs", ()) if one.get("output") and one.get("point_count")]
        paths = [self.folder / one["output"] for one in inputs]
        return [path for path in paths if path.is_file()]


def read_result(folder: Path, run: dict[str, Any] | None = None) -> Result:
    """Open an output folder, with the content of ``run.json`` if that is not written yet; or InputError."""
    run = _record(folder) if run is None else json.loads(json.dumps(run, default=str))
    try:
        frame = MapFrame(**{**run["frame"], "origin": tuple(run["frame"]["origin"])})
    except (KeyError, TypeError) as error:
        raise InputError(f"{folder / RUN}: does not say where the map frame lies: run it again") from error
    return Result(folder, run, frame)


def _record(folder: Path) -> dict[str, Any]:
    path = folder / RUN
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder: give the output folder of lidar-buildings run")
    if not path.is_file():
        raise InputError(f"{folder}: contains no {RUN}: give the output folder of a finished run")
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}): run it again") from error
    if not isinstance(run, dict):
        raise InputError(f"{path}: is not the record of a run: give the output folder of a finished run")
    return run


def _of_layers(path: Path, frame: MapFrame) -> Iterator[ReportedBuilding]:
    """Yield the rows of the outlines with the traced rings of the same names; or these alone."""
    layers = {str(name) for name, _ in pyogrio.list_layers(path)}
    traced: dict[str, tuple[Any, int]] = {}  # ring and number
    if "traced" in layers:
        layer = read_layer(path, "traced")
        rings = zip(_in_map(layer.geometries, frame), layer.columns["building_id"].tolist(), strict=True)
        traced = dict(zip(layer.columns[READABLE_ID], rings, strict=True))
    outlines = read_layer(path, "outlines")
    columns = {name: values.tolist() for name, values in outlines.columns.items()}
    own_names = [str(name) for name in columns.pop(READABLE_ID)]
    shapes = _in_map(outlines.geometries, frame)
    for row, (name, shape) in enumerate(zip(own_names, shapes, strict=True)):
        values = {key: column[row] for key, column in columns.items()}
        known = {key: None if value != value else value for key, value in values.items()}
        ring, _ = traced.pop(name, (None, 0))
        yield ReportedBuilding(name, known, shape, ring)
    for name, (ring, number) in traced.items():  # of a run that ended before outlines were regularised
        yield ReportedBuilding(str(name), {"building_id": number}, None, ring)


def _in_map(geometries: NDArray[Any], frame: MapFrame) -> NDArray[Any]:
    return np.asarray(
        shapely.transform(
            shapely.force_2d(geometries), lambda xy: frame.to_map(np.insert(xy, 2, 0.0, axis=1))[:, :2]
        )
    )
