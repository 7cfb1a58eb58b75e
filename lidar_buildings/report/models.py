"""The solids of buildings as arrays of triangles, whole millimetres of the map frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.solids.face_triangles import face_pieces, triangles_of
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from lidar_buildings.io.models.cityjson import load_feature
from lidar_buildings.io.results.run_folder import Share

#: Kind of surface → its number in the page.
KINDS = {GROUND_SURFACE: 0, WALL_SURFACE: 1, ROOF_SURFACE: 2}
#: Text of so many characters is a job: some ten buildings, enough to pay for its way to another process.
_BATCH = 400_000


class ModelArrays(NamedTuple):
    """Solids one after the other."""

    vertices: NDArray[np.int32]  #: each building's once, for all its levels [mm], shape (n_vertices, 3)
    #: Rows of the vertices, counter-clockwise from outside, shape (n_triangles, 3).
    triangles: NDArray[np.uint32]
    faces: NDArray[np.uint16]  #: number of the solid's face that a triangle is of, shape (n_triangles,)
    kinds: NDArray[np.uint8]  #: values of `KINDS`, shape (n_triangles,)
    #: The building's row, the level of detail times ten, its first triangle, and how many it has, shape
    #: (n_solids, 4).
    solids: NDArray[np.int32]
    n_left_out: int  #: buildings beyond the budget


class _Solid(NamedTuple):
    """A solid of a building; `triangles` are rows of the building's vertices."""

    level: int
    triangles: NDArray[np.uint32]
    faces: NDArray[np.uint16]
    kinds: NDArray[np.uint8]


class _Building(NamedTuple):
    """All solids of a building."""

    name: str
    vertices: NDArray[np.int32]
    solids: list[_Solid]


def model_arrays(
    lines: Iterable[str], names: Sequence[str], most_triangles: int, share: Share = map
) -> ModelArrays:
    """
    Divide the solids of buildings, from their CityJSONFeatures, into triangles.

    Beyond the most triangles buildings are left out. `share`, as `map`, may do its jobs, some buildings each,
    in other processes. InputError if a line is no such feature.
    """
    row_of = {name: row for row, name in enumerate(names)}
    vertices = [np.empty((0, 3), dtype=np.int32)]
    triangles = [np.empty((0, 3), dtype=np.uint32)]
    faces, kinds = [np.empty(0, dtype=np.uint16)], [np.empty(0, dtype=np.uint8)]
    solids: list[tuple[int, int, int, int]] = []
    n_vertices = n_triangles = n_left_out = 0
    for building in chain.from_iterable(share(_cut_all, list(_batches(lines)))):
        if n_triangles >= most_triangles:
            n_left_out += 1
            continue
        for solid in building.solids:
            solids.append((row_of[building.name], solid.level, n_triangles, len(solid.triangles)))
            triangles.append(solid.triangles + np.uint32(n_vertices))
            faces.append(solid.faces)
            kinds.append(solid.kinds)
            n_triangles += len(solid.triangles)
        vertices.append(building.vertices)
        n_vertices += len(building.vertices)
    return ModelArrays(
        np.concatenate(vertices),
        np.concatenate(triangles),
        np.concatenate(faces),
        np.concatenate(kinds),
        np.array(solids, dtype=np.int32).reshape(-1, 4),
        n_left_out,
    )


def _batches(lines: Iterable[str]) -> Iterator[list[str]]:
    batch: list[str] = []
    size = 0
    for line in lines:
        if size >= _BATCH:
            yield batch
            batch, size = [], 0
        batch.append(line)
        size += len(line)
    if batch:
        yield batch


def _cut_all(lines: Sequence[str]) -> list[_Building]:
    """Divide some buildings."""
    return [_cut(load_feature(line)[0]) for line in lines]


def _cut(feature: dict[str, Any]) -> _Building:
    vertices = np.array(feature["vertices"], dtype=np.int32).reshape(-1, 3)
    geometries = feature["CityObjects"][feature["id"]]["geometry"]
    return _Building(feature["id"], vertices, [_solid(one, vertices * GRID) for one in geometries])


def _solid(geometry: dict[str, Any], vertices: NDArray[np.float64]) -> _Solid:
    """Divide a solid into triangles."""
    surfaces = [KINDS[surface["type"]] for surface in geometry["semantics"]["surfaces"]]
    (shell,), (values,) = geometry["boundaries"], geometry["semantics"]["values"]
    faces = [tuple(map(tuple, rings)) for rings in shell]
    by_face = [triangles_of(pieces) for pieces in face_pieces(vertices, faces)]
    counts = [len(one) for one in by_face]
    corners = chain.from_iterable(chain.from_iterable(by_face))
    return _Solid(
        round(10 * float(geometry["lod"])),
        np.fromiter(corners, dtype=np.uint32, count=3 * sum(counts)).reshape(-1, 3),
        np.repeat(np.arange(len(counts), dtype=np.uint16), counts),
        np.repeat(np.array([surfaces[value] for value in values], dtype=np.uint8), counts),
    )
