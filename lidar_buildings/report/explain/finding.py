"""What is said of a building, and the parameters that bear on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import CLASS_NAMES, PointClass
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.parameters import StageConfig, spec_of
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.clouds.point_columns import xyz_of
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.pipeline.config import STAGE_CONFIGS
from lidar_buildings.report.contents import limits_of
from lidar_buildings.report.summary_words import changed_parameters

_Config = TypeVar("_Config", bound=StageConfig)


class Finding(NamedTuple):
    """One line, and which parameters would change what it tells."""

    text: str
    parameters: tuple[str, ...] = ()  #: ``stage.name``


class Limits:
    """The values of a run's parameters, of which many are multiples of the building's point spacing [m]."""

    def __init__(self, run: dict[str, Any], spacing: float) -> None:
        self._told = run.get("parameters", {})
        self._spacing = spacing

    def value(self, parameter: str) -> Any:
        """Return what a parameter was set to; lengths in spacings as metres."""
        value, member = self._of(parameter)
        return value * self._spacing if spec_of(member).unit == "spacings" else value

    def config(self, kind: type[_Config]) -> _Config:
        """Return a stage's config as it was in the run."""
        told = {f"{kind.stage}.{one.name}" for one in fields(kind)}
        return kind(**{name.split(".")[1]: self._of(name)[0] for name in told})

    def lines(self, parameters: Iterable[str]) -> list[str]:
        """Return a line on each of some parameters, those first that differ from their defaults."""
        once = dict.fromkeys(parameters)
        found = [(parameter, *self._of(parameter)) for parameter in once]
        lines = []
        for parameter, value, member in sorted(found, key=lambda one: bool(one[1] == one[2].default)):
            unit = spec_of(member).unit
            here = f", {value * self._spacing:.2f} m here" if unit == "spacings" else ""
            changed = f", the default is {member.default}" if value != member.default else ""
            what = f"{parameter} = {value} {unit}".rstrip()
            lines.append(f"{what}{here}{changed}: {spec_of(member).description}")
        return lines

    def other_changes(self, parameters: Iterable[str]) -> list[str]:
        """Return a line on each stage's parameter that differs from its default and is not among these."""
        known = set(parameters)
        return [
            f"{name} = {value}, the default is {default}"
            for name, value, default in changed_parameters({"parameters": self._told})
            if name not in known and name.split(".")[0] in STAGE_CONFIGS
        ]

    def _of(self, parameter: str) -> tuple[Any, Field[Any]]:
        stage, name = parameter.split(".")
        member = next(one for one in fields(STAGE_CONFIGS[stage]) if one.name == name)
        return self._told.get(stage, {}).get(name, member.default), member


_COLUMNS = {
    "classification": "classification",
    "height": "HeightAboveGround",
    "facade": "Facade",
    "building_id": "BuildingId",
    "plane_id": "PlaneId",
    "return_number": "return_number",
    "number_of_returns": "number_of_returns",
}


@dataclass(frozen=True, eq=False)
class Site:
    """Points within a box, noise left out."""

    points: NDArray[np.float64]  #: map frame [m], shape (n, 3)
    #: As the clouds say; 0 where they do not. Heights above ground [m]. Shape (n,).
    classification: NDArray[np.float64]
    height: NDArray[np.float64]
    facade: NDArray[np.float64]
    building_id: NDArray[np.float64]
    plane_id: NDArray[np.float64]
    return_number: NDArray[np.float64]
    number_of_returns: NDArray[np.float64]

    def select(self, chosen: NDArray[np.bool_]) -> Site:
        """Return some of the points."""
        return Site(*(values[chosen] for values in self.__dict__.values()))

    def per_class(self) -> str:
        """Say how many points there are of each class."""
        codes, counts = np.unique(self.classification, return_counts=True)
        named = sorted(zip(counts.tolist(), codes.astype(int).tolist(), strict=True), reverse=True)
        return ", ".join(f"{n:,} {CLASS_NAMES.get(code, f'class {code}')}" for n, code in named) or "none"


def read_site(clouds: Iterable[Path], frame: MapFrame, box: Rectangle) -> Site:
    """Read the points of classified clouds within a box; InputError if one cannot be read."""
    parts = [np.empty((0, 3 + len(_COLUMNS)))]
    for path in clouds:
        cloud = open_cloud(path)
        if not box.touches(limits_of(cloud, frame)):
            continue
        known = set(cloud.header.point_format.dimension_names)
        for chunk in cloud.chunks():
            xyz = frame.to_map(xyz_of(chunk))
            inside = box.holds(xyz[:, 0], xyz[:, 1])
            inside &= ~np.isin(chunk["classification"], (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
            columns = [
                np.asarray(chunk[name], dtype=np.float64)[inside] if name in known else np.zeros(inside.sum())
                for name in _COLUMNS.values()
            ]
            parts.append(np.column_stack([xyz[inside], *columns]))
    table = np.concatenate(parts)
    height = table[:, 4] * frame.vertical_unit
    return Site(table[:, :3], table[:, 3], height, *table[:, 5:].T)
