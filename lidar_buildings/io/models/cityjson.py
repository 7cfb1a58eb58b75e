"""
City models as CityJSONSeq 2.0: a header line, then one line per building and per piece of the terrain.

Vertices are written as whole multiples of the output grid in the map frame; the header's transform turns
them into the source's coordinates. So what was checked is what is written, in metres and in feet alike.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import BEYOND, are_held, checked_id
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.ids import readable_id
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Face, Solid
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.io.files.atomic_files import atomic_file, compact_json
from lidar_buildings.io.files.reference_systems import epsg_code
from lidar_buildings.io.models.survey_building import (
    BUILDING_FIELDS,
    Add,
    ModelHeading,
    SurveyBuilding,
    TerrainMesh,
    face_attributes,
    in_source_units,
    told_in_units,
)

#: The surfaces that come first, if nothing is told of a face of theirs; each roof face has one of its own.
_SHARED = (GROUND_SURFACE, WALL_SURFACE)
#: The file with one document, and how many buildings it has at most.
DOCUMENT, _MOST_IN_DOCUMENT = "city_model.city.json", 5000
#: Decimals of the extent's coordinates.
_DECIMALS = 6


@contextmanager
def cityjson_file(path: Path, heading: ModelHeading) -> Iterator[Add]:
    """
    Give a function that adds a building's line, or terrain, to a file that appears when the block ends.

    Of as many buildings as viewers hold in memory there is one document of CityJSON beside it, too.
    """
    header = header_line(heading.frame, crs=heading.crs, extent=heading.extent, title=heading.title)
    document, n_buildings = path.with_name(DOCUMENT), 0
    with atomic_file(path) as temporary:
        with open(temporary, "w", encoding="utf-8") as file:
            file.write(f"{header}\n")

            def add(one: SurveyBuilding | TerrainMesh) -> None:
                nonlocal n_buildings
                line = _terrain_line(one) if isinstance(one, TerrainMesh) else one.line
                n_buildings += not isinstance(one, TerrainMesh)
                if line:
                    file.write(f"{line}\n")

            yield add
        document.unlink(missing_ok=True)
        if n_buildings <= _MOST_IN_DOCUMENT:
            with open(temporary, encoding="utf-8") as lines, atomic_file(document) as whole:
                whole.write_text(f"{compact_json(whole_document(lines))}\n", encoding="utf-8")


def header_line(
    frame: MapFrame, *, crs: str = "", extent: NDArray[np.float64] | None = None, title: str = ""
) -> str:
    """
    Return the first line of a CityJSONSeq: version, transform and metadata.

    The reference system, the frame's together with a vertical one, is left out where no EPSG code is known,
    since CityJSON has no other way to name it; of a pair that has no code the horizontal one is named.
    `extent` is of all buildings in the map frame [m].
    """
    translate = frame.to_source(np.zeros((1, 3)))[0]
    header: dict[str, Any] = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": (GRID / frame.units).tolist(), "translate": translate.tolist()},
        "CityObjects": {},
        "vertices": [],
    }
    metadata: dict[str, Any] = {}
    if extent is not None:
        metadata["geographicalExtent"] = np.round(frame.to_source(extent), _DECIMALS).ravel().tolist()
    code = epsg_code(crs) or epsg_code(frame.crs)
    if code:
        metadata["referenceSystem"] = f"https://www.opengis.net/def/crs/EPSG/0/{code}"
    if title:
        metadata["title"] = title
    if metadata:
        header["metadata"] = metadata
    return compact_json(header)


def whole_document(sequence: Iterable[str]) -> dict[str, Any]:
    """Return the lines of a CityJSONSeq, of which the first is the header, as one CityJSON document."""
    lines = iter(sequence)
    document: dict[str, Any] = json.loads(next(lines))
    objects, vertices = document["CityObjects"], document["vertices"]
    for line in lines:
        feature = json.loads(line)
        for name, thing in feature["CityObjects"].items():
            for geometry in thing.get("geometry", ()):
                geometry["boundaries"] = _renumbered(geometry["boundaries"], len(vertices))
            objects[name] = thing
        vertices += feature["vertices"]
    return document


def _renumbered(boundaries: list[Any], first: int) -> list[Any]:
    """Return boundaries with the numbers of their vertices counted from another first one."""
    return [one + first if isinstance(one, int) else _renumbered(one, first) for one in boundaries]


def feature_id(anchor: tuple[float, float], frame: MapFrame) -> str:
    """Return the name of the feature of a building with this anchor point [m]."""
    x, y, _ = frame.to_source(np.array([[*anchor, 0.0]]))[0]
    return readable_id(x, y)


def feature_line(
    model: BuildingModel,
    building_id: int,
    frame: MapFrame,
    attributes: dict[str, Any],
    *,
    anchor: tuple[float, float],
) -> str:
    """
    Return one building's line, without line break.

    A building without any solid still gets its line, without geometry. Attributes, in metres and in the map
    frame, are written in the source's units, sorted by name; the feature's id is made from the anchor.
    """
    name = feature_id(anchor, frame)
    vertices: dict[tuple[int, int, int], int] = {}
    geometry = [
        _geometry(lod, model.solids[lod], vertices, frame, model.of_faces.get(lod))
        for lod in sorted(model.solids)
    ]
    state = {"building_id": int(building_id), "status": model.status.value, "reason": model.reason}
    written = in_source_units(state | attributes | {"building_id": int(building_id)}, frame)
    building = {"type": "Building", "attributes": dict(sorted(written.items())), "geometry": geometry}
    return _line(name, building, [list(vertex) for vertex in vertices])


def _terrain_line(mesh: TerrainMesh) -> str:
    """Return a square's line; a composite surface is connected, so each part is one of its own."""
    first, second, third = mesh.triangles.T
    pairs = np.concatenate([first, second]), np.concatenate([second, third])
    part = sets_of_pairs(len(mesh.vertices), *pairs)[first]
    parts = (mesh.triangles[part == one].tolist() for one in dict.fromkeys(part.tolist()))
    geometry = [
        {"type": "CompositeSurface", "lod": "2", "boundaries": [[corners] for corners in own]}
        for own in parts
    ]
    relief = {"type": "TINRelief", "geometry": geometry}
    return _line(mesh.name, relief, np.rint(mesh.vertices / GRID).astype(np.int64).tolist())


def _line(name: str, thing: dict[str, Any], vertices: list[Any]) -> str:
    feature = {"type": "CityJSONFeature", "id": name, "CityObjects": {name: thing}, "vertices": vertices}
    return compact_json(feature)


class CityFeature(NamedTuple):
    """What a line says of its building, see `SurveyBuilding`."""

    readable_id: str
    attributes: dict[str, Any]
    extent: NDArray[np.float64] | None = None  #: of all its solids, shape (2, 3), None without any [m]
    lod: str = ""
    solid: Solid | None = None
    roof_faces: tuple[dict[str, Any], ...] = ()


def parse_feature(line: str) -> CityFeature:
    """Read attributes and the finest solid of a line of `feature_line`; InputError if it is no such line."""
    try:
        feature, _ = load_feature(line)
        name = feature["id"]
        building = feature["CityObjects"][name]
        geometry = max(building["geometry"], key=lambda one: one["lod"], default=None)
        if geometry is None:
            return CityFeature(name, building["attributes"])
        steps = np.array(feature["vertices"], dtype=np.float64).reshape(-1, 3)
        vertices, extent = steps / round(1 / GRID), np.stack([steps.min(axis=0), steps.max(axis=0)]) * GRID
        if not are_held(extent).all():
            raise ValueError(f"a vertex cannot be held: {BEYOND}")
        surfaces = geometry["semantics"]["surfaces"]
        kinds = [surfaces[number] for number in geometry["semantics"]["values"][0]]
        (shell,) = geometry["boundaries"]
        solid = Solid(*faces_of_shell(shell, vertices), tuple(kind["type"] for kind in kinds))
        roofs = tuple(kind for kind in kinds if kind["type"] == ROOF_SURFACE)
        return CityFeature(name, building["attributes"], extent, geometry["lod"], solid, roofs)
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError) as error:
        raise _no_feature(line, error) from error


def checked_feature(line: str) -> int:
    """Return the building id of a line that others wrote; InputError if no files could be made of it."""
    name, attributes = parse_feature(line)[:2]
    for one, value in attributes.items():
        kind = BUILDING_FIELDS.get(one, object)
        allowed = {str: (str, list), float: (float, int)}.get(kind, kind)
        if value is not None and not isinstance(value, allowed):
            what = f"{one} = {str(value)[:40]!r}: must be of type {kind.__name__}"
            raise InputError(f"building {name[:40]!r}: {what}")
    return checked_id(attributes["building_id"])


def load_feature(line: str) -> tuple[dict[str, Any], int]:
    """Return the JSON of a line of `feature_line`, and its building id; InputError if it is no such line."""
    try:
        feature: dict[str, Any] = json.loads(line)
        if feature["type"] != "CityJSONFeature":
            raise ValueError(f"its type is {feature['type']}")
        return feature, checked_id(feature["CityObjects"][feature["id"]]["attributes"]["building_id"])
    except (ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
        raise _no_feature(line, error) from error


def _no_feature(line: str, error: Exception) -> InputError:
    return InputError(f"line {line[:60]!r}: no CityJSONFeature of a building: {error!r}")


def _geometry(
    lod: str,
    solid: Solid,
    vertices: dict[tuple[int, int, int], int],
    frame: MapFrame,
    of_faces: Sequence[dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """Return a solid as CityJSON geometry; its vertices are added to the feature's, each once."""
    steps = np.rint(solid.vertices / GRID).astype(np.int64).tolist()
    rows = [vertices.setdefault((x, y, z), len(vertices)) for x, y, z in steps]
    shell = [[[rows[i] for i in ring] for ring in face] for face in solid.faces]
    told = of_faces or [{}] * len(solid.faces)
    plain = {kind for kind, known in zip(solid.semantics, told, strict=True) if not known}
    surfaces: list[dict[str, Any]] = [{"type": surface} for surface in _SHARED if surface in plain]
    shared: dict[tuple[Any, ...], int] = {(one["type"],): k for k, one in enumerate(surfaces)}
    values = []
    for face, kind, told_of in zip(solid.faces, solid.semantics, told, strict=True):
        known = told_in_units(told_of, frame)
        if kind == ROOF_SURFACE:
            values.append(len(surfaces))
            surfaces.append({"type": kind} | face_attributes(solid.face_rings(face), frame) | known)
            continue
        key = (kind, *known.values())
        if key not in shared:
            shared[key] = len(surfaces)
            surfaces.append({"type": kind} | known)
        values.append(shared[key])
    semantics = {"surfaces": surfaces, "values": [values]}
    return {"type": "Solid", "lod": lod, "boundaries": [shell], "semantics": semantics}


def faces_of_shell(shell: Any, vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], tuple[Face, ...]]:
    """Return the vertices that a shell of CityJSON uses, in the order of their first use, and its faces."""
    used = list(dict.fromkeys(i for face in shell for ring in face for i in ring))
    row_of = {i: row for row, i in enumerate(used)}
    return vertices[used], tuple(tuple(tuple(row_of[i] for i in ring) for ring in face) for face in shell)
