"""City models as CAD drawings: DXF with a layer per level of detail and surface, and outlines with arcs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.roof_lines import KINDS
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Solid, ring_edges
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.models.arcs import ring_arcs
from lidar_buildings.io.models.dxf_entities import (
    CornerText,
    DxfEntities,
    coordinate_text,
    corner_texts,
    dxf_frame,
)
from lidar_buildings.io.models.survey_building import SurveyBuilding, TerrainMesh

OUTLINE, COURTYARD = "OUTLINE", "OUTLINE_COURTYARD"
_SURFACES = {ROOF_SURFACE: "ROOF", WALL_SURFACE: "WALL", GROUND_SURFACE: "GROUND"}
TERRAIN = "TERRAIN"
#: Layer of each kind of line of a roof.
LINES = {kind: f"LINE_{kind.upper()}" for kind in KINDS}


def layer_name(level: str, surface: str) -> str:
    """Return the layer of a surface, as ``LOD22_ROOF``."""
    return f"LOD{level.replace('.', '')}_{_SURFACES[surface]}"


@contextmanager
def dxf_file(path: Path, frame: MapFrame) -> Iterator[Callable[[SurveyBuilding | TerrainMesh], None]]:
    """
    Give a function that adds a building's outline, finest solid and roof's lines, or terrain, to a drawing.

    Entities are written one by one, as ezdxf would write them: it holds a whole drawing in memory. The file
    appears when the block ends well; OutputError if it cannot be written.
    """
    around = dxf_frame(frame.horizontal_unit)
    with atomic_file(path) as temporary, open(temporary, "wb") as file:
        file.write(around.before.encode("ascii"))
        entities = DxfEntities()
        yield _Drawing(file, entities, frame).add
        file.write(around.after.encode("ascii"))
        file.seek(around.seed_at)
        file.write(f"{entities.next_handle:X}".encode("ascii"))


class _Drawing:
    """Draws buildings one after the other."""

    def __init__(self, file: BinaryIO, entities: DxfEntities, frame: MapFrame) -> None:
        self._file = file
        self._entities = entities
        self._frame = frame

    def add(self, building: SurveyBuilding | TerrainMesh) -> None:
        """Draw a building, or a piece of the terrain."""
        if isinstance(building, TerrainMesh):
            self._file.writelines(text.encode("ascii") for text in self._terrain(building))
            return
        parts = self._outline(building)
        if building.solid is not None:
            parts += self._faces(building, building.solid)
            parts += self._lines(building)
        self._file.write("".join(parts).encode("ascii"))

    def _outline(self, building: SurveyBuilding) -> list[str]:
        """Draw a building's rings at the ground; a point where there is no ring."""
        known = [one for one in (building.outline, building.traced) if one and len(one.exterior)]
        if not known:
            return []
        outline = known[0]
        data = self._entities.extended_data([building.readable_id, *_known_attributes(building.attributes)])
        ground = building.attributes.get("ground_elevation") or 0.0
        drawn = []
        for layer, ring in zip((OUTLINE, *(COURTYARD,) * len(outline.holes)), outline.rings, strict=True):
            places = self._corners(ring)
            if len(ring) >= 3:
                rows, bulges = ring_arcs(ring)
                corners = [places[k] for k in rows.tolist()]
                drawn.append(self._entities.closed_polyline(layer, corners, bulges.tolist(), ground, data))
            elif layer == OUTLINE:
                x, y, _ = places[0]
                drawn.append(self._entities.point(layer, (x, y, coordinate_text(ground)), data))
        return drawn

    def _faces(self, building: SurveyBuilding, solid: Solid) -> list[str]:
        """Draw a solid's faces; edges within a face are hidden."""
        data = self._entities.extended_data([building.readable_id])
        corners = self._corners(solid.vertices)
        layers = {kind: layer_name(building.lod, kind) for kind in _SURFACES}
        drawn = []
        for face, pieces, kind in zip(solid.faces, building.pieces, solid.semantics, strict=True):
            seen = {edge for ring in face for edge in ring_edges(ring)} if len(pieces) > 1 else None
            for rows in pieces:
                hidden = [] if seen is None else [edge not in seen for edge in ring_edges(rows)]
                drawn.append(self._entities.face(layers[kind], [corners[k] for k in rows], data, hidden))
        return drawn

    def _lines(self, building: SurveyBuilding) -> list[str]:
        """Draw the lines of a building's roof."""
        data = self._entities.extended_data([building.readable_id])
        ends = np.array([line.ends for line in building.lines]).reshape(-1, 3)
        corners = self._corners(ends)
        return [
            self._entities.line(LINES[line.kind], start, end, data)
            for line, start, end in zip(building.lines, corners[::2], corners[1::2], strict=True)
        ]

    def _terrain(self, mesh: TerrainMesh) -> Iterator[str]:
        data = self._entities.extended_data([mesh.name])
        corners = self._corners(mesh.vertices)
        for rows in mesh.triangles.tolist():
            yield self._entities.face(TERRAIN, [corners[k] for k in rows], data, [])

    def _corners(self, vertices: NDArray[np.float64]) -> list[CornerText]:
        """Return vertices of 2 or 3 coordinates as text, in source coordinates."""
        full = np.zeros((len(vertices), 3))
        full[:, : vertices.shape[1]] = vertices
        return corner_texts(self._frame.to_source(full))


def _known_attributes(attributes: Mapping[str, Any]) -> list[str]:
    return [f"{name}={value}" for name, value in sorted(attributes.items()) if value not in (None, "")]
