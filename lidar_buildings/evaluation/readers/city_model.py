"""Building models of any CityJSON or CityJSONSeq file, in metres."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.exceptions import CRSError

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.solids.shell import (
    GROUND_SURFACE,
    OUTER_CEILING_SURFACE,
    ROOF_SURFACE,
    WALL_SURFACE,
    Face,
    Solid,
)
from lidar_buildings.evaluation.readers.metric_polygons import files_of
from lidar_buildings.evaluation.scores.models import unit_normal
from lidar_buildings.io.models.cityjson import faces_of_shell

#: What a folder is searched for: the output of a run, the truth of a simulated survey, then any of this kind.
IN_FOLDER = ("city_model.city.jsonl", "truth.city.jsonl")
SEQUENCE = "*.city.jsonl"
#: Types of city objects that are read; parts are added to their buildings.
_TYPES = ("Building", "BuildingPart")
_EPSG = re.compile(r"EPSG/+\d*/*(\d+)$|EPSG:+(\d+)$")
#: A surface whose normal rises or falls by less is a wall where a file does not say.
_UPRIGHT = 0.01


@dataclass(frozen=True, eq=False)
class CityBuilding:
    """One building as read."""

    name: str
    attributes: dict[str, Any]  #: as written, in the file's units
    solids: dict[str, tuple[Solid, ...]]  #: level of detail → the building's solids, one per part [m]

    def finest(self, lod: str) -> tuple[str, tuple[Solid, ...]]:
        """Return the finest level up to this one and its solids; an empty name where there is none."""
        levels = [level for level in self.solids if level <= lod]
        return (max(levels), self.solids[max(levels)]) if levels else ("", ())


@dataclass(frozen=True, eq=False)
class CityModel:
    """The buildings of a file or a folder."""

    buildings: tuple[CityBuilding, ...]
    crs: str  #: ``"EPSG:28992"``, empty if the file does not say


def holds_city_model(path: Path) -> bool:
    """Whether the path names a CityJSON file or a folder that holds one."""
    if path.is_dir():
        return any(path.rglob(SEQUENCE))
    return path.suffix.lower() in (".jsonl", ".json")


def read_city_model(path: Path) -> CityModel:
    """
    Read the solids of all buildings, with the parts of a building as one.

    Of a file, the output folder of a run, the folder of a simulated survey, or one with sequences; InputError
    if there is no such file, or it is no CityJSON.
    """
    buildings: list[CityBuilding] = []
    crs = ""
    for file in files_of(path, IN_FOLDER, lambda: path.rglob(SEQUENCE), "a file with building models"):
        header: dict[str, Any] = {}
        try:
            for document in _documents(file):
                header = header or document
                transform = document.get("transform", header.get("transform", {}))
                match = _EPSG.search(document.get("metadata", {}).get("referenceSystem", ""))
                crs = crs or (f"EPSG:{match[1] or match[2]}" if match else "")
                vertices = _vertices(document, transform) * _unit_of(crs)
                buildings.extend(_buildings(document.get("CityObjects", {}), vertices))
        except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
            why = f"{type(error).__name__}: {error}"  # a UnicodeDecodeError's repr holds the whole file
            raise InputError(f"{file}: cannot be read as CityJSON: {why}") from error
    return CityModel(tuple(buildings), crs)


def _documents(file: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a sequence, or the one document of a plain file."""
    text = file.read_text(encoding="utf-8")
    # not splitlines(): texts within a line may hold separators of other kinds
    texts = text.split("\n") if file.suffix.lower() == ".jsonl" else [text]
    for one in texts:
        if one.strip():
            document = json.loads(one)
            if document["type"] not in ("CityJSON", "CityJSONFeature"):
                raise ValueError(f"its type is {document['type']}")
            yield document


def _vertices(document: dict[str, Any], transform: dict[str, Any]) -> NDArray[np.float64]:
    rows = np.array(document["vertices"], dtype=np.float64).reshape(-1, 3)
    return rows * transform.get("scale", (1.0,) * 3) + transform.get("translate", (0.0,) * 3)


def _unit_of(crs: str) -> NDArray[np.float64]:
    try:
        axes = pyproj.CRS.from_user_input(crs).axis_info if crs else []
    except CRSError:
        axes = []
    factors = [float(axis.unit_conversion_factor) for axis in axes] or [1.0]
    return np.array([factors[0], factors[0], factors[2] if len(factors) > 2 else factors[0]])


def _buildings(objects: dict[str, Any], vertices: NDArray[np.float64]) -> Iterator[CityBuilding]:
    for name, thing in objects.items():
        if thing["type"] not in _TYPES or any(parent in objects for parent in thing.get("parents", ())):
            continue
        solids: dict[str, tuple[Solid, ...]] = {}
        members = [thing, *(objects[child] for child in thing.get("children", ()) if child in objects)]
        for member in members:
            for geometry in member.get("geometry", ()):
                level = str(geometry.get("lod", ""))
                solids[level] = solids.get(level, ()) + _solids(geometry, vertices)
        attributes = {
            key: value for one in reversed(members) for key, value in one.get("attributes", {}).items()
        }
        yield CityBuilding(name, attributes, {level: parts for level, parts in solids.items() if parts})


def _solids(geometry: dict[str, Any], vertices: NDArray[np.float64]) -> tuple[Solid, ...]:
    """Return the shells of a geometry; one without any, as a footprint, has no solids."""
    kind, boundaries = geometry["type"], geometry["boundaries"]
    meaning = geometry.get("semantics") or {}
    surfaces = [surface["type"] for surface in meaning.get("surfaces", ())]
    values = meaning.get("values")
    if kind == "Solid":
        return (_solid(boundaries[0], values and values[0], surfaces, vertices),)
    if kind in ("MultiSolid", "CompositeSolid"):
        return tuple(
            _solid(solid[0], values and values[k] and values[k][0], surfaces, vertices)
            for k, solid in enumerate(boundaries)
        )
    if kind in ("MultiSurface", "CompositeSurface") and geometry.get("lod", "0")[0] != "0":
        return (_solid(boundaries, values, surfaces, vertices),)
    return ()


def _solid(shell: Any, values: Any, surfaces: list[str], vertices: NDArray[np.float64]) -> Solid:
    """Return a shell with its own vertices, in the order of their first use."""
    own, faces = faces_of_shell(shell, vertices)
    kinds = values or [None] * len(faces)
    named = [None if kind is None else surfaces[kind] for kind in kinds]
    return Solid(
        own, faces, tuple(_kind_of(own, face, kind) for face, kind in zip(faces, named, strict=True))
    )


def _kind_of(vertices: NDArray[np.float64], face: Face, named: str | None) -> str:
    """Return roof, wall, ground or soffit: as the file says, or else by where the face looks."""
    if named in (GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, OUTER_CEILING_SURFACE):
        return named
    up = float(unit_normal(vertices[list(face[0])])[2])
    return WALL_SURFACE if abs(up) < _UPRIGHT else ROOF_SURFACE if up > 0 else GROUND_SURFACE
