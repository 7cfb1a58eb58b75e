"""
Buildings and terrain as binary glTF 2.0 with ids and attributes of features.

Written here: pygltflib holds the JSON as classes but neither lays out buffers nor knows the two extensions,
and trimesh writes no extension at all, so that with either what stands below would stay.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings import __version__
from lidar_buildings.io.files.atomic_files import compact_json

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
    """
    Return a file's content: triangles of buildings and of the terrain, either of which may be empty.

    `fields` says which attributes are int, float or str; rows come in the order of the features. The terrain
    has none.
    """
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
