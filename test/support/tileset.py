"""3D Tiles read back by the letter of the specifications: corners in geocentric coordinates, attributes."""

from __future__ import annotations

import json
import struct
from itertools import pairwise

import numpy as np

_TYPES = {5126: "<f4", 5121: "u1"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Glb:
    """A binary glTF file."""

    def __init__(self, path):
        data = path.read_bytes()
        magic, version, size, length, kind = struct.unpack_from("<4s4I", data)
        assert (magic, version, size, kind) == (b"glTF", 2, len(data), 0x4E4F534A)
        self.json = json.loads(data[20 : 20 + length])
        self.binary = data[28 + length :]

    def view(self, number):
        view = self.json["bufferViews"][number]
        return self.binary[view["byteOffset"] :][: view["byteLength"]]

    def attribute(self, name, primitive=0):
        """Return an attribute of a primitive, one row per corner."""
        number = self.json["meshes"][0]["primitives"][primitive]["attributes"][name]
        accessor = self.json["accessors"][number]
        stride = self.json["bufferViews"][accessor["bufferView"]]["byteStride"]
        dtype, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        rows = np.frombuffer(self.view(accessor["bufferView"]), np.uint8).reshape(-1, stride)
        assert len(rows) == accessor["count"]
        start = accessor["byteOffset"]
        return np.ascontiguousarray(rows[:, start : start + dtype.itemsize * width]).view(dtype)

    def column(self, name):
        """Return a column of the table of attributes, None if it has none."""
        extension = self.json["extensions"]["EXT_structural_metadata"]
        (table,) = extension["propertyTables"]
        known = extension["schema"]["classes"][table["class"]]["properties"][name]
        if name not in table["properties"]:
            return [None] * table["count"]
        stored = table["properties"][name]
        values = self.view(stored["values"])
        if known["type"] == "STRING":
            ends = np.frombuffer(self.view(stored["stringOffsets"]), "<u4")
            column = [values[a:b].decode() for a, b in pairwise(ends)]
        else:
            column = np.frombuffer(
                values, {"UINT32": "<u4", "FLOAT64": "<f8"}[known["componentType"]]
            ).tolist()
        return [None if value == known["noData"] else value for value in column]


def tiles_of(folder):
    """Yield each tile with the matrix to geocentric coordinates and its parent."""
    tileset = json.loads((folder / "tileset.json").read_text())
    waiting = [(tileset["root"], np.eye(4), None)]
    while waiting:
        tile, above, parent = waiting.pop()
        matrix = above @ np.reshape(tile.get("transform", np.eye(4).ravel()), (4, 4)).T
        yield tile, matrix, parent
        waiting += [(child, matrix, tile) for child in tile.get("children", [])]


def contents_of(folder):
    """Yield the file of each tile that has one, with its matrix."""
    for tile, matrix, _ in tiles_of(folder):
        if tile.get("content", {}).get("uri", "").endswith(".glb"):
            yield Glb(folder / tile["content"]["uri"]), matrix


def geocentric(file, matrix, primitive=0):
    """Return the corners of a file's triangles in geocentric coordinates: its y axis is up."""
    x, y, z = file.attribute("POSITION", primitive).astype(np.float64).T
    return np.column_stack([x, -z, y, np.ones(len(x))]) @ matrix.T[:, :3]
