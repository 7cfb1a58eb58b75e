"""
City models as meshes: Wavefront OBJ, an object per building, a material per kind of surface.

Coordinates are local, in the source's units, with z up: viewers hold them as float32, in which those of a
country's grid have steps of decimetres. The header says what to add.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.triangulation import triangles_of
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.reference_systems import unit_name
from lidar_buildings.io.models.survey_building import (
    MATERIALS,
    TERRAIN,
    Add,
    ModelHeading,
    SurveyBuilding,
    TerrainMesh,
)

Triangle = Sequence[int]
#: Decimals of coordinates: the grid's millimetres, and as fine where a unit is no metre.
_DECIMALS, _DECIMALS_OF_OTHER_UNITS = 3, 5


@contextmanager
def obj_file(path: Path, heading: ModelHeading) -> Iterator[Add]:
    """
    Give a function that adds a building's finest solid, or terrain, to an OBJ file; its materials go beside.

    Solids are closed as meshes, too: triangles share their vertices, and neighbours their edges. Both files
    appear when the block ends well; OutputError if one cannot be written.
    """
    materials = path.with_suffix(".mtl")
    with atomic_file(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        offset = " ".join(repr(c) for c in heading.frame.to_source(np.zeros((1, 3)))[0].tolist())
        file.write(
            "# The finest solid of each building, and the terrain; z is up.\n"
            f"# Reference system: {' '.join(heading.frame.crs.split()) or 'unknown'}\n"
            f"# Unit of x, y and z: {unit_name(heading.frame.vertical_unit)}\n"
            f"# Offset to add to all coordinates: {offset}\n"
            f"mtllib {materials.name}\n"
        )
        mesh = _Mesh(file, heading.frame)
        yield mesh.add
        with atomic_file(materials) as beside:
            # each looks the same from both sides and does not shine
            colours = [(name, " ".join(map(str, rgb))) for name, rgb in mesh.materials]
            parts = [f"newmtl {name}\nKd {rgb}\nKa {rgb}\nillum 1\n" for name, rgb in colours]
            beside.write_text("".join(parts), encoding="utf-8")


#: Name and colour (sRGB, 0 to 1).
_Material = tuple[str, tuple[float, float, float]]


class _Mesh:
    """Writes buildings one after the other; vertices are numbered through the file."""

    def __init__(self, file: TextIO, frame: MapFrame) -> None:
        self._file = file
        self._units = frame.units
        self._decimals = _DECIMALS if (frame.units == 1.0).all() else _DECIMALS_OF_OTHER_UNITS
        self._n_vertices = 0
        self.materials: list[_Material] = []  #: those used

    def add(self, building: SurveyBuilding | TerrainMesh) -> None:
        """Write a building, or why it has no solid; or a piece of the terrain."""
        if isinstance(building, TerrainMesh):
            self._file.write(f"o {building.name}\n")
            self._write(building.vertices, {TERRAIN: building.triangles.tolist()})
            return
        if building.solid is None:
            reason = " ".join(str(building.attributes.get("reason") or "unknown").split())
            self._file.write(f"# {building.readable_id}: no solid: {reason}\n")
            return
        self._file.write(f"o {building.readable_id}\n# LoD{building.lod}\n")
        faces = list(zip(building.pieces, building.solid.semantics, strict=True))
        by_material = {
            material: [corners for pieces, of in faces if of == kind for corners in triangles_of(pieces)]
            for kind, material in MATERIALS.items()
        }
        self._write(building.solid.vertices, by_material)

    def _write(
        self, vertices: NDArray[np.float64], triangles: Mapping[_Material, Sequence[Triangle]]
    ) -> None:
        """Write an object's vertices, and its triangles by material."""
        places = np.round(vertices / self._units, self._decimals) + 0.0  # no minus zero
        lines = [f"v {x!r} {y!r} {z!r}\n" for x, y, z in places.tolist()]
        first = self._n_vertices + 1
        for material, own in triangles.items():
            if not own:
                continue
            if material not in self.materials:
                self.materials.append(material)
            lines.append(f"usemtl {material[0]}\n")
            lines += [f"f {a + first} {b + first} {c + first}\n" for a, b, c in own]
        self._file.writelines(lines)
        self._n_vertices += len(vertices)
