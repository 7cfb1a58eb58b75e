"""The solids of buildings as arrays of triangles, whole millimetres of the map frame."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.solids.face_triangles import face_pieces, triangles_of
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE

#: Kind of surface → its number in the page.
KINDS = {GROUND_SURFACE: 0, WALL_SURFACE: 1, ROOF_SURFACE: 2}


class ModelArrays(NamedTuple):
    """
    Solids one after the other.

    Attributes
    ----------
    vertices : ndarray of int32, shape (n_vertices, 3)
        Each building's once, for all its levels [mm].
    triangles : ndarray of uint32, shape (n_triangles, 3)
        Rows of the vertices, counter-clockwise from outside.
    faces : ndarray of uint16, shape (n_triangles,)
        Number of the solid's face that a triangle is of.
    kinds : ndarray of uint8, shape (n_triangles,)
        Values of `KINDS`.
    solids : ndarray of int32, shape (n_solids, 4)
        The building's row, the level of detail times ten, its first triangle, and how many it has.
    n_left_out : int
        Buildings beyond the budget.
    """

    vertices: NDArray[np.int32]
    triangles: NDArray[np.uint32]
    faces: NDArray[np.uint16]
    kinds: NDArray[np.uint8]
    solids: NDArray[np.int32]
    n_left_out: int


def model_arrays(
    features: Iterable[tuple[str, dict[str, Any]]], names: Sequence[str], most_triangles: int
) -> ModelArrays:
    """
    Divide the solids of buildings into triangles.

    Parameters
    ----------
    features : iterable of (str, dict)
        Name and CityJSONFeature.
    names : sequence of str
        Of the buildings, by row.
    most_triangles : int
        What would be more is left out, building by building.
    """
    row_of = {name: row for row, name in enumerate(names)}
    vertices: list[list[int]] = []
    triangles: list[NDArray[np.int64]] = []
    labels: list[tuple[int, int]] = []
    solids: list[tuple[int, int, int, int]] = []
    n_left_out = 0
    for name, feature in features:
        if len(labels) >= most_triangles:
            n_left_out += 1
            continue
        places = np.array(feature["vertices"], dtype=np.float64).reshape(-1, 3) * GRID
        for geometry in feature["CityObjects"][name]["geometry"]:
            cut, of_cut = _triangles(geometry, places)
            level = round(10 * float(geometry["lod"]))
            solids.append((row_of[name], level, len(labels), len(cut)))
            triangles.append(np.array(cut, dtype=np.int64).reshape(-1, 3) + len(vertices))
            labels += of_cut
        vertices += feature["vertices"]
    number, kind = np.array(labels, dtype=np.int64).reshape(-1, 2).T
    return ModelArrays(
        np.array(vertices, dtype=np.int32).reshape(-1, 3),
        np.concatenate([*triangles, np.empty((0, 3), dtype=np.int64)]).astype(np.uint32),
        number.astype(np.uint16),
        kind.astype(np.uint8),
        np.array(solids, dtype=np.int32).reshape(-1, 4),
        n_left_out,
    )


def _triangles(
    geometry: dict[str, Any], vertices: NDArray[np.float64]
) -> tuple[list[tuple[int, int, int]], list[tuple[int, int]]]:
    """Return a solid's triangles as rows of vertices, and of each its face's number and kind."""
    surfaces = [KINDS[surface["type"]] for surface in geometry["semantics"]["surfaces"]]
    (shell,), (values,) = geometry["boundaries"], geometry["semantics"]["values"]
    cut: list[tuple[int, int, int]] = []
    labels: list[tuple[int, int]] = []
    faces = [tuple(map(tuple, rings)) for rings in shell]
    for number, (pieces, surface) in enumerate(zip(face_pieces(vertices, faces), values, strict=True)):
        of_face = triangles_of(pieces)
        cut += of_face
        labels += [(number, surfaces[surface])] * len(of_face)
    return cut, labels
