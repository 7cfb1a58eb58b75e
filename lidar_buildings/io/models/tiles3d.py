"""
City models as 3D Tiles 1.1: a tree of squares, each with a glTF file of its buildings.

A building stands in one file only (refinement ``ADD``), the larger it is the higher up in the tree: from afar
one sees large buildings, and what is missing of a square is smaller than its geometric error says.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.exceptions import CRSError, ProjError

from lidar_buildings import __version__
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.triangulation import triangles_of
from lidar_buildings.io.files.atomic_files import Waiting, atomic_folder, compact_json
from lidar_buildings.io.files.reference_systems import (
    GEOCENTRIC,
    GEODETIC,
    east_north_up,
    geoid_of_grid,
    horizontal_part,
)
from lidar_buildings.io.models.survey_building import (
    MATERIALS,
    READABLE_ID,
    TERRAIN,
    Add,
    ModelHeading,
    SurveyBuilding,
    TerrainMesh,
)

# Binary glTF 2.0 with ids and attributes of features: pygltflib holds the JSON as classes but neither lays
# out buffers nor knows the two extensions, and trimesh writes no extension at all.

#: A corner of a triangle; corners are not shared, as each face has its own normal and colour.
CORNER = np.dtype([("position", "<f4", 3), ("normal", "<f4", 3), ("colour", "u1", 4), ("feature", "<f4")])
_ACCESSORS = {
    "POSITION": ("position", 5126, "VEC3"),
    "NORMAL": ("normal", 5126, "VEC3"),
    "COLOR_0": ("colour", 5121, "VEC4"),
    "_FEATURE_ID_0": ("feature", 5126, "SCALAR"),
}
_ARRAY_BUFFER = 34962
_CLASS = "building"
#: glTF, version 2; chunks of JSON and of bytes.
_MAGIC, _VERSION, _JSON, _BIN = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
#: Type of an attribute → what the schema says of it, and how its numbers are stored. No 64-bit integers:
#: CesiumJS does not know their `noData`.
_NUMBERS: dict[type, tuple[dict[str, Any], str]] = {
    int: ({"type": "SCALAR", "componentType": "UINT32", "noData": 2**32 - 1}, "<u4"),
    float: ({"type": "SCALAR", "componentType": "FLOAT64", "noData": -9999.0}, "<f8"),
}
_TEXT = {"type": "STRING", "noData": ""}


def corners_of(
    places: NDArray[np.float64], triangles: NDArray[np.intp], colours: NDArray[np.uint8], feature: int = 0
) -> NDArray[Any]:
    """
    Return the corners of triangles, `CORNER`, right, up and back as glTF has its axes.

    Places are east, north and up [m], colours linear; `feature` is the row of their building in the table of
    attributes. Triangles without area are left out.
    """
    soup = places[triangles]
    normals = np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0])
    lengths = np.sqrt((normals**2).sum(axis=1))
    has_area = lengths > 0.0
    corners = np.zeros((int(has_area.sum()), 3), CORNER)
    corners["position"] = _y_up(soup[has_area])
    corners["normal"] = _y_up(normals[has_area] / lengths[has_area, None])[:, None]
    corners["colour"] = np.insert(colours[has_area], 3, 255, axis=1)[:, None]
    corners["feature"] = feature
    return corners.reshape(-1)


def linear_colour(srgb: Sequence[float]) -> NDArray[np.uint8]:
    """Return a colour (sRGB, 0 to 1) as glTF stores it beside vertices: linear, 0 to 255."""
    value = np.asarray(srgb)
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.rint(linear * 255).astype(np.uint8)


@dataclass
class _Buffer:
    """Bytes in views, each of which begins at a multiple of eight."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)

    def add(self, data: bytes, **members: Any) -> int:
        self.data.extend(b"\0" * (-len(self.data) % 8))
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)} | members)
        self.data.extend(data)
        return len(self.views) - 1


def glb(
    buildings: NDArray[Any],
    terrain: NDArray[Any],
    fields: Mapping[str, type],
    rows: Sequence[Mapping[str, Any]],
) -> bytes:
    """Return a glTF of triangles, either may be empty; `fields` are int, float or str, rows by feature."""
    buffer = _Buffer()
    accessors: list[dict[str, Any]] = []
    primitives = [_primitive(corners, buffer, accessors) for corners in (buildings, terrain) if len(corners)]
    content: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"lidar_buildings {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "accessors": accessors,
    }
    if len(buildings):
        ids = {"featureCount": len(rows), "attribute": 0, "propertyTable": 0}
        primitives[0]["extensions"] = {"EXT_mesh_features": {"featureIds": [ids]}}
        table = _property_table(fields, rows, buffer.add)
        known = {column: _TEXT if kind is str else _NUMBERS[kind][0] for column, kind in fields.items()}
        schema = {"id": f"{_CLASS}s", "classes": {_CLASS: {"properties": known}}}
        content["extensionsUsed"] = ["EXT_mesh_features", "EXT_structural_metadata"]
        content["extensions"] = {"EXT_structural_metadata": {"schema": schema, "propertyTables": [table]}}
    content |= {"bufferViews": buffer.views, "buffers": [{"byteLength": len(buffer.data)}]}
    return _packed(content, bytes(buffer.data))


def _primitive(corners: NDArray[Any], buffer: _Buffer, accessors: list[dict[str, Any]]) -> dict[str, Any]:
    view = buffer.add(corners.tobytes(), byteStride=CORNER.itemsize, target=_ARRAY_BUFFER)
    attributes = {}
    for name, (column, component, kind) in _ACCESSORS.items():
        attributes[name] = len(accessors)
        offset = CORNER.fields[column][1]  # type: ignore[index]
        accessor = {
            "bufferView": view, "byteOffset": offset, "componentType": component, "count": len(corners),
            "type": kind,
        }  # fmt: skip
        if column == "colour":
            accessor["normalized"] = True
        if column == "position":
            low, high = (corners[column].min(axis=0), corners[column].max(axis=0))
            accessor |= {"min": low.astype(float).tolist(), "max": high.astype(float).tolist()}
        accessors.append(accessor)
    return {"attributes": attributes, "material": 0, "mode": 4}


def _packed(content: dict[str, Any], data: bytes) -> bytes:
    """Return the two chunks of a file, each of which ends at a multiple of four."""
    text = compact_json(content).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    size = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<5I", _MAGIC, _VERSION, size, len(text), _JSON)
    return head + text + struct.pack("<2I", len(data), _BIN) + data


def _y_up(east_north_up: NDArray[np.float64]) -> NDArray[np.float64]:
    east, north, up = np.moveaxis(east_north_up, -1, 0)
    return np.stack([east, up, -north], axis=-1)


def _property_table(
    fields: Mapping[str, type], rows: Sequence[Mapping[str, Any]], add: Callable[[bytes], int]
) -> dict[str, Any]:
    """Return a table; `add` stores bytes. What is missing is `noData`; a column of no text is left out."""
    properties = {}
    for column, kind in fields.items():
        values = [row.get(column) for row in rows]
        if kind is str:
            texts = ["" if value is None else str(value) for value in values]
            if any(texts):  # a view has at least one byte, and is as long as its texts
                encoded = [text.encode() for text in texts]
                ends = np.cumsum([0, *map(len, encoded)]).astype("<u4")
                properties[column] = {"values": add(b"".join(encoded)), "stringOffsets": add(ends.tobytes())}
        else:
            known, dtype = _NUMBERS[kind]
            numbers = [known["noData"] if value is None else value for value in values]
            properties[column] = {"values": add(np.array(numbers, dtype=dtype).tobytes())}
    return {"class": _CLASS, "count": len(rows), "properties": properties}


#: A vertical system that changes heights by less has no grid here [m].
_NO_CHANGE = 1e-3


class NoPlaceError(LidarBuildingsError):
    """It is not known where on the earth a survey lies."""


class EarthFrame:
    """
    Turns map coordinates into east, north and up at the map's origin.

    Places come from the horizontal system. Ellipsoidal heights come from a grid of the geoid's heights, if
    one is given, or from that of the vertical system, where PROJ has it; else they are the source's
    elevations plus a height of the geoid that is given [m], by which `lacks_geoid` models are off. Both
    systems together cannot be asked without the grid: PROJ then leaves out the change of datum, too, which is
    108 m in the Netherlands. NoPlaceError if the reference system is not known, or PROJ knows no way from it
    to WGS 84.
    """

    def __init__(self, frame: MapFrame, crs: str, geoid_height: float = 0.0, geoid_grid: str = "") -> None:
        if not frame.crs:
            raise NoPlaceError("the inputs name no reference system")
        self._frame, self._grid = frame, geoid_grid
        self._geoid_height = 0.0 if geoid_grid else geoid_height
        self._geoid = geoid_of_grid(geoid_grid) if geoid_grid else None
        try:
            horizontal = horizontal_part(frame.crs)
            self._plan = pyproj.Transformer.from_crs(horizontal, GEODETIC, always_xy=True)
            self._geocentric = pyproj.Transformer.from_crs(GEODETIC, GEOCENTRIC, always_xy=True)
            compound = pyproj.CRS.from_user_input(crs)
            #: the way of places and heights together, None where no vertical system is known
            self._spatial: pyproj.Transformer | None = None
            if len(compound.axis_info) >= 3 and self._geoid is None:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    target = self._plan.target_crs
                    self._spatial = pyproj.Transformer.from_crs(compound, target, always_xy=True)
        except (CRSError, ProjError) as error:
            raise NoPlaceError(" ".join(str(error).split())[:200]) from error
        origin = np.zeros((1, 3))
        self.has_grid = False
        if self._spatial is not None:
            change = self._spatial.transform(*frame.to_source(origin)[0])[2] - frame.origin[2]
            self.has_grid = bool(np.isfinite(change) and abs(change) > _NO_CHANGE)
        longitude, latitude, height = self._geodetic(origin)[0]
        if not np.isfinite([longitude, latitude]).all():
            raise NoPlaceError(f"the map's origin is outside the area of {frame.crs.split(',')[0]}")
        if not np.isfinite(height):
            raise NoPlaceError(f"the map's origin is outside the grid {geoid_grid}")
        self._origin = self._ecef(origin)[0]
        self._axes = east_north_up(longitude, latitude)

    @property
    def heights(self) -> str:
        """What the heights are, in words."""
        if self._geoid is not None:
            return f"ellipsoidal: the source's elevations + the geoid's heights of {Path(self._grid).name}"
        if self.has_grid:
            return "ellipsoidal: turned from the source's elevations by the grid of their vertical system"
        return (
            f"the source's elevations + {self._geoid_height:g} m (model_writer.geoid_height): PROJ has no "
            "grid that turns them into ellipsoidal ones"
        )

    @property
    def lacks_geoid(self) -> bool:
        """Whether elevations are taken for ellipsoidal heights, for want of anything better."""
        return not (self.has_grid or self._geoid or self._geoid_height)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The matrix, shape (4, 4), that turns east, north and up into geocentric coordinates."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self._axes.T, self._origin
        return matrix

    def local(self, map_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn map coordinates, shape (n, 3), into east, north and up at the map's origin [m]."""
        # column by column: a product of matrices may depend on the number of rows in its last bit
        away = (self._ecef(map_xyz) - self._origin).T
        return np.column_stack([a * away[0] + b * away[1] + c * away[2] for a, b, c in self._axes])

    def _geodetic(self, map_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = self._frame.to_source(map_xyz).T
        if self.has_grid and self._spatial is not None:
            return np.column_stack(self._spatial.transform(x, y, z))
        longitude, latitude = self._plan.transform(x, y)
        height = map_xyz[:, 2] + self._frame.origin[2] + self._geoid_height
        if self._geoid is not None:
            height = self._geoid.transform(longitude, latitude, height)[2]
        return np.column_stack([longitude, latitude, height])

    def _ecef(self, map_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(self._geocentric.transform(*self._geodetic(map_xyz).T))


TILESET = "tileset.json"
#: Side of the smallest squares [m]: some hundred houses of a town, about a megabyte.
_SIDE = 256.0
#: A square holds what is smaller than this share of its side, and no smaller square does.
_SHARE = 1.0 / 8.0
_COLOURS = {kind: linear_colour(colour) for kind, (_, colour) in MATERIALS.items()}
_TERRAIN_COLOUR = linear_colour(TERRAIN[1])
#: Boxes are so much larger than what they hold: what float32 and decimals round [m].
_MARGIN = 1e-3


class _Node(NamedTuple):
    """A square of the tree: its level, 0 for the smallest, and column and row among those of its level."""

    level: int
    column: int
    row: int

    @property
    def parent(self) -> _Node:
        return _Node(self.level + 1, self.column // 2, self.row // 2)

    @property
    def name(self) -> str:
        return f"{self.level}_{self.column}_{self.row}"


class _Mesh(NamedTuple):
    """What waits on disk: places in the map frame, triangles, their colours, attributes (none of terrain)."""

    vertices: NDArray[np.float64]
    triangles: NDArray[np.intp]
    colours: NDArray[np.uint8]
    attributes: dict[str, Any] | None


#: Of a file: its name, where its coordinates begin, and least and greatest ones, east, north and up [m].
_Content = tuple[str, NDArray[np.float64], NDArray[np.float64]]


@contextmanager
def tiles3d_folder(path: Path, heading: ModelHeading) -> Iterator[Add]:
    """
    Give a function that adds a building's finest solid, or terrain, to a tileset.

    Meshes wait in a temporary file, so that memory holds one square's at a time. The folder appears when the
    block ends well; OutputError if a file cannot be written. The heading must say where the map lies.
    """
    earth = heading.earth
    if earth is None:
        raise ValueError("heading.earth is None: must say where the map frame lies on the earth")
    with atomic_folder(path) as folder, TemporaryFile(dir=folder) as spool:
        meshes: Waiting[_Node, _Mesh] = Waiting(spool)

        def add(one: SurveyBuilding | TerrainMesh) -> None:
            mesh = _terrain(one) if isinstance(one, TerrainMesh) else _building(one)
            if mesh is not None:
                meshes.add(_square_of(mesh), mesh)

        yield add
        fields = {READABLE_ID: str} | heading.fields
        contents = {
            node: _write(folder, node, meshes.of(node), earth, fields) for node in sorted(meshes.places)
        }
        _write_tileset(folder / TILESET, contents, earth)


def _building(building: SurveyBuilding) -> _Mesh | None:
    if building.solid is None:
        return None
    by_face = [triangles_of(pieces) for pieces in building.pieces]
    triangles = np.array([corners for own in by_face for corners in own], dtype=np.intp).reshape(-1, 3)
    kinds = np.array([_COLOURS[kind] for kind in building.solid.semantics])
    colours = np.repeat(kinds, [len(own) for own in by_face], axis=0)
    attributes = {READABLE_ID: building.readable_id, **building.attributes}
    return _Mesh(building.solid.vertices, triangles, colours, attributes)


def _terrain(mesh: TerrainMesh) -> _Mesh:
    colours = np.broadcast_to(_TERRAIN_COLOUR, mesh.triangles.shape)
    return _Mesh(mesh.vertices, mesh.triangles.astype(np.intp), colours, None)


def _square_of(mesh: _Mesh) -> _Node:
    """Return the smallest square that may hold a mesh, by its middle and its size; terrain is no building."""
    low, high = mesh.vertices[:, :2].min(axis=0), mesh.vertices[:, :2].max(axis=0)
    column, row = np.floor((low + high) / 2.0 / _SIDE).astype(int).tolist()
    node = _Node(0, column, row)
    size = 0.0 if mesh.attributes is None else float(np.hypot(*(high - low)))
    while size >= _largest(node.level):
        node = node.parent
    return node


def _largest(level: int) -> float:
    """Return the size that buildings in squares of a level and below do not reach [m]."""
    return _SHARE * _SIDE * 2.0**level


def _write(
    folder: Path, node: _Node, meshes: Iterator[_Mesh], earth: EarthFrame, fields: dict[str, type]
) -> _Content:
    held = list(meshes)
    sizes = np.cumsum([len(mesh.vertices) for mesh in held])
    places = earth.local(np.concatenate([mesh.vertices for mesh in held]))
    low, high = places.min(axis=0), places.max(axis=0)
    origin = np.rint((low + high) / 2.0)
    buildings, terrain, rows = [], [], []
    for mesh, own in zip(held, np.split(places - origin, sizes[:-1]), strict=True):
        corners = corners_of(own, mesh.triangles, mesh.colours, len(rows))
        if mesh.attributes is None:
            terrain.append(corners)
        else:
            buildings.append(corners)
            rows.append(mesh.attributes)
    nothing = np.zeros(0, CORNER)
    content = glb(np.concatenate([nothing, *buildings]), np.concatenate([nothing, *terrain]), fields, rows)
    name = f"{node.name}.glb"
    (folder / name).write_bytes(content)
    return name, origin, np.stack([low - _MARGIN, high + _MARGIN])


def _write_tileset(path: Path, contents: dict[_Node, _Content], earth: EarthFrame) -> None:
    """Write the tree: a root without content above at most four squares, which the map's axes part."""
    children: dict[_Node, set[_Node]] = {}
    level, squares = 0, {node for node in contents if node.level == 0}
    while len(squares) > 4 or any(node.level > level for node in contents):
        for node in squares:
            children.setdefault(node.parent, set()).add(node)
        level += 1
        squares = {node for node in (*children, *contents) if node.level == level}
    below = [_tile(node, contents, children, np.zeros(3)) for node in sorted(squares)]
    root = {
        "transform": earth.matrix.T.ravel().tolist(),
        "boundingVolume": _box([box for _, box in below] or [np.array([[-1.0] * 3, [1.0] * 3])]),
        "geometricError": _largest(level),
        "refine": "ADD",
    } | _members(below)
    generator, extras = f"lidar_buildings {__version__}", {"heights": earth.heights}
    asset = {"version": "1.1", "generator": generator, "extras": extras}
    tileset = {"asset": asset, "geometricError": _largest(level + 1), "root": root}
    path.write_text(f"{compact_json(tileset)}\n", encoding="utf-8")


def _tile(
    node: _Node,
    contents: dict[_Node, _Content],
    children: dict[_Node, set[_Node]],
    begin: NDArray[np.float64],
) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Return a square's tile and its box; `begin` is where its parent's coordinates begin [m]."""
    content, tile = contents.get(node), dict[str, Any]()
    origin = begin if content is None else content[1]
    below = [_tile(child, contents, children, origin) for child in sorted(children.get(node, ()))]
    boxes = [box for _, box in below]
    if content is not None:
        boxes.append(content[2])
        shift = np.eye(4)
        shift[:3, 3] = origin - begin
        tile = {"transform": shift.T.ravel().tolist(), "content": {"uri": content[0]}}
    tile["boundingVolume"] = _box(boxes, origin)
    tile["geometricError"] = _largest(node.level - 1) if below else 0.0
    low, high = np.min(boxes, axis=(0, 1)), np.max(boxes, axis=(0, 1))
    return tile | _members(below), np.stack([low, high])


def _members(below: list[tuple[dict[str, Any], NDArray[np.float64]]]) -> dict[str, Any]:
    return {"children": [tile for tile, _ in below]} if below else {}


def _box(
    boxes: list[NDArray[np.float64]], origin: NDArray[np.float64] | float = 0.0
) -> dict[str, list[float]]:
    """Return a box along the axes round all of some, seen from a place: its middle and its half axes."""
    low, high = np.min(boxes, axis=(0, 1)) - origin, np.max(boxes, axis=(0, 1)) - origin
    x, y, z = ((high - low) / 2.0).tolist()
    return {"box": [*((low + high) / 2.0).tolist(), x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z]}
