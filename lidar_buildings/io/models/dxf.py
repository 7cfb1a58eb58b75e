"""City models as CAD drawings: DXF with a layer per level of detail and surface, and outlines with arcs."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, pairwise
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.roof_lines import KINDS
from lidar_buildings.core.solids.shell import (
    GROUND_SURFACE,
    OUTER_CEILING_SURFACE,
    ROOF_SURFACE,
    WALL_SURFACE,
    ring_edges,
)
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.reference_systems import FOOT, US_SURVEY_FOOT, is_same_unit
from lidar_buildings.io.models.survey_building import Add, ModelHeading, SurveyBuilding, TerrainMesh

#: Chords that turn by more are walls of a polygon: an octagon turns by 45° [deg].
_WIDEST_TURN = 44.0
#: How many times its coordinates' rounding a chord's length, or a vertex's distance from the arc, may differ:
#: both ends of a chord are rounded in x and y, and neighbours are compared.
_TOLERANCE = 4.0
#: A half circle whose rounded chords turn by this share more is still one;
#: wide margin: chords are metres, rounding millimetres.
_OVER = 1e-2
#: An arc that leaves its chord by fewer roundings than this is a straight line; wide margin above
#: `_TOLERANCE`.
_LEAST_BULGE = 20.0


class ArcRing(NamedTuple):
    """The segments of a ring: the rows at which they begin, ascending, and their bulges."""

    rows: NDArray[np.int64]
    bulges: NDArray[np.float64]


def ring_arcs(ring: NDArray[np.float64]) -> ArcRing:
    """
    Find the arcs in an open ring [m].

    Consecutive edges of one length that turn by one angle are the chords of an arc: regularised outlines draw
    theirs so. What differs by more than rounding to float32, which messages carry, is left as it is, and so
    are polygons with few sides. A bulge is the tangent of a quarter of the angle that a segment sweeps, 0 for
    a straight one, positive to the left, at most about 1 (half a circle).
    """
    n = len(ring)
    precision = float(np.spacing(np.float32(np.abs(ring).max(initial=1.0))))
    bulges = np.zeros(n)
    kept = np.ones(n, dtype=bool)
    for first, n_chords, turn in _runs(ring, _TOLERANCE * precision):
        # an arc is half a circle at most
        n_parts = max(math.ceil(n_chords * abs(turn) / math.pi - _OVER), 1)
        for start, end in pairwise(first + n_chords * k // n_parts for k in range(n_parts + 1)):
            rows = np.arange(start, end + 1) % n
            bulge = math.tan((end - start) * turn / 4.0)
            if _is_arc(ring[rows], bulge, precision):
                bulges[rows[0]] = bulge
                kept[rows[1:-1]] = False
    rows = np.flatnonzero(kept)
    return ArcRing(rows, bulges[rows])


def _runs(ring: NDArray[np.float64], tolerance: float) -> list[tuple[int, int, float]]:
    """Return (first vertex, chords, turn [rad]) of every run of two or more equal chords and turns."""
    n = len(ring)
    if n < 4:
        return []
    step = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(*step.T)
    before = np.roll(step, 1, axis=0)
    cross = before[:, 0] * step[:, 1] - before[:, 1] * step[:, 0]
    turn = np.arctan2(cross, np.einsum("ij,ij->i", before, step))
    equal = np.abs(length - np.roll(length, 1)) <= tolerance
    widest = math.radians(_WIDEST_TURN)
    bend = equal & (np.abs(turn) * length > tolerance) & (np.abs(turn) < widest)
    if not bend.any():
        return []
    # joint k goes on to joint k + 1: the edge between them turns by the same angle at both of its ends
    goes_on = bend & np.roll(bend, -1) & (np.abs(turn - np.roll(turn, -1)) * length <= 2.0 * tolerance)
    if goes_on.all():
        return [(0, n, float(turn.mean()))]
    starts = np.flatnonzero(bend & ~np.roll(goes_on, 1))
    return [_run(turn, goes_on, int(joint)) for joint in starts]


def _run(turn: NDArray[np.float64], goes_on: NDArray[np.bool_], joint: int) -> tuple[int, int, float]:
    n = len(turn)
    joints = [joint]
    while goes_on[joints[-1]]:
        joints.append((joints[-1] + 1) % n)
    return (joint - 1) % n, len(joints) + 1, float(turn[joints].mean())


def _is_arc(vertices: NDArray[np.float64], bulge: float, precision: float) -> bool:
    """Whether vertices lie on the arc between the first and the last of them."""
    chord = vertices[-1] - vertices[0]
    width = float(np.hypot(*chord))
    if 0.5 * abs(bulge) * width < _LEAST_BULGE * precision:
        return False
    # from the chord's middle to the centre, as a multiple of the chord turned left
    centre = 0.5 * (vertices[0] + vertices[-1])
    centre = centre + np.array([-chord[1], chord[0]]) * (1.0 / bulge - bulge) / 4.0
    radius = 0.25 * width * (abs(bulge) + 1.0 / abs(bulge))
    off = np.abs(np.hypot(*(vertices - centre).T) - radius)
    return bool(off.max() <= _TOLERANCE * precision)


#: Decimals of coordinates: a tenth of a millimetre, and finer in feet; and of bulges.
_DECIMALS, _DECIMALS_OF_BULGES = 4, 9
#: Most characters of one text of an entity's data.
_LONGEST_TEXT = 255

#: A corner's coordinates as text: one corner belongs to many faces.
CornerText = tuple[str, str, str]
#: A drawing without entities; written by ``python -m bench.common.empty_drawing`` with ezdxf, whose import
#: alone takes longer than most drawings.
EMPTY = Path(__file__).with_name("empty_drawing.dxf")
#: Name under which entities carry their building's id, and outlines its attributes.
APPLICATION = "LIDAR_BUILDINGS"
#: Handle of the model space in it, to which all entities belong.
_OWNER = "17"
#: Handle of the first entity; the frame's own are lower, and all that follow have eight digits, too.
_FIRST_HANDLE = 0x10000000
#: Metres per unit → number of $INSUNITS (and whether the unit is metric).
_UNITS = {1.0: (6, 1), FOOT: (2, 0), US_SURVEY_FOOT: (21, 0)}
_ENTITIES = "  0\nSECTION\n  2\nENTITIES\n"


def _plain(text: str) -> str:
    """Return a text on one line in ASCII; other characters are written by their number, as DXF has it."""
    line = " ".join(text.split())
    plain = "".join(c if c.isascii() else f"\\U+{ord(c):04X}" if ord(c) < 0x10000 else "?" for c in line)
    return plain[:_LONGEST_TEXT]


OUTLINE, COURTYARD = "OUTLINE", "OUTLINE_COURTYARD"
_SURFACES = {
    ROOF_SURFACE: "ROOF",
    WALL_SURFACE: "WALL",
    GROUND_SURFACE: "GROUND",
    OUTER_CEILING_SURFACE: "SOFFIT",
}
TERRAIN = "TERRAIN"
#: Layer of each kind of line of a roof.
LINES = {kind: f"LINE_{kind.upper()}" for kind in KINDS}


def layer_name(level: str, surface: str) -> str:
    """Return the layer of a surface, as ``LOD22_ROOF``."""
    return f"LOD{level.replace('.', '')}_{_SURFACES[surface]}"


@contextmanager
def dxf_file(path: Path, heading: ModelHeading) -> Iterator[Add]:
    """
    Give a function that adds a building's outline, finest solid and roof's lines, or terrain, to a drawing.

    Entities are written one by one, as ezdxf would write them: it holds a whole drawing in memory. The file
    appears when the block ends well; OutputError if it cannot be written.
    """
    before, after = _around(heading.frame.vertical_unit)
    with atomic_file(path) as temporary, open(temporary, "wb") as file:
        file.write(before.encode("ascii"))
        drawing = _Drawing(file, heading.frame)
        yield drawing.add
        file.write(after.encode("ascii"))
        # the next free handle has as many digits as the first
        file.seek(before.index(f"{_FIRST_HANDLE:X}"))
        file.write(f"{drawing.next_handle:X}".encode("ascii"))


def _around(metres_per_unit: float) -> tuple[str, str]:
    unit, metric = next(
        (found for metres, found in _UNITS.items() if is_same_unit(metres, metres_per_unit)), (0, 1)
    )
    before, entities, after = EMPTY.read_text(encoding="ascii").partition(_ENTITIES)
    for name, value in (("MEASUREMENT", metric), ("INSUNITS", unit), ("HANDSEED", f"{_FIRST_HANDLE:X}")):
        before = re.sub(rf"(\${name}\n.*\n).*", rf"\g<1>{value}", before)
    return before + entities, after


class _Drawing:
    """Draws buildings one after the other; each entity has a handle of its own."""

    def __init__(self, file: BinaryIO, frame: MapFrame) -> None:
        self._file, self._frame = file, frame
        self.next_handle = _FIRST_HANDLE

    def add(self, one: SurveyBuilding | TerrainMesh) -> None:
        """Draw a building, or a piece of the terrain."""
        if isinstance(one, TerrainMesh):
            entities = self._terrain(one)
        else:
            entities = chain(self._outline(one), self._faces(one), self._lines(one))
        self._file.writelines(text.encode("ascii") for text in entities)

    def _outline(self, building: SurveyBuilding) -> Iterator[str]:
        """Draw a building's rings at the ground; a point where there is no ring."""
        known = [one for one in (building.outline, building.traced) if one and len(one.exterior)]
        if not known:
            return
        outline = known[0]
        told = sorted(building.attributes.items())
        known_values = [f"{name}={value}" for name, value in told if value not in (None, "")]
        data = _extended_data([building.readable_id, *known_values])
        ground = repr(round(building.attributes.get("ground_elevation") or 0.0, _DECIMALS) + 0.0)
        for layer, ring in zip((OUTLINE, *(COURTYARD,) * len(outline.holes)), outline.rings, strict=True):
            corners = self._corners(ring)
            if len(ring) >= 3:
                rows, bulges = ring_arcs(ring)
                places = "".join(
                    f" 10\n{corners[k][0]}\n 20\n{corners[k][1]}\n"
                    + (f" 42\n{round(bulge, _DECIMALS_OF_BULGES)!r}\n" if bulge else "")
                    for k, bulge in zip(rows.tolist(), bulges.tolist(), strict=True)
                )
                closed = f" 90\n{len(rows)}\n 70\n1\n 38\n{ground}\n"
                yield self._entity("LWPOLYLINE", layer, f"AcDbPolyline\n{closed}{places}{data}")
            elif layer == OUTLINE:
                yield self._entity("POINT", layer, f"AcDbPoint\n{_places((*corners[0][:2], ground))}{data}")

    def _faces(self, building: SurveyBuilding) -> Iterator[str]:
        """Draw a solid's faces; edges within a face are hidden."""
        solid = building.solid
        if solid is None:
            return
        data = _extended_data([building.readable_id])
        corners = self._corners(solid.vertices)
        layers = {kind: layer_name(building.lod, kind) for kind in _SURFACES}
        for face, pieces, kind in zip(solid.faces, building.pieces, solid.semantics, strict=True):
            seen = {edge for ring in face for edge in ring_edges(ring)} if len(pieces) > 1 else None
            for rows in pieces:
                hidden = [] if seen is None else [edge not in seen for edge in ring_edges(rows)]
                yield self._face(layers[kind], [corners[k] for k in rows], data, hidden)

    def _lines(self, building: SurveyBuilding) -> Iterator[str]:
        data = _extended_data([building.readable_id])
        corners = self._corners(np.array([line.ends for line in building.lines]).reshape(-1, 3))
        for line, start, end in zip(building.lines, corners[::2], corners[1::2], strict=True):
            yield self._entity("LINE", LINES[line.kind], f"AcDbLine\n{_places(start, end)}{data}")

    def _terrain(self, mesh: TerrainMesh) -> Iterator[str]:
        data = _extended_data([mesh.name])
        corners = self._corners(mesh.vertices)
        for rows in mesh.triangles.tolist():
            yield self._face(TERRAIN, [corners[k] for k in rows], data, [])

    def _face(self, layer: str, corners: Sequence[CornerText], data: str, hidden: Sequence[bool]) -> str:
        """Return a face of three or four corners; edges to the next corner may be `hidden`."""
        mark = ""
        if any(hidden):
            # with three corners the last edge is the fourth, and the third has no length
            flags = sum(1 << k for k, one in enumerate(hidden[:-1]) if one) | 8 * hidden[-1]
            mark = f" 70\n{flags}\n"
        # three corners are written as four, of which the last two are one
        return self._entity("3DFACE", layer, f"AcDbFace\n{_places(*corners[:3], corners[-1])}{mark}{data}")

    def _entity(self, kind: str, layer: str, content: str) -> str:
        handle = self.next_handle
        self.next_handle += 1
        return f"  0\n{kind}\n  5\n{handle:X}\n330\n{_OWNER}\n100\nAcDbEntity\n  8\n{layer}\n100\n{content}"

    def _corners(self, vertices: NDArray[np.float64]) -> list[CornerText]:
        full = np.zeros((len(vertices), 3))
        full[:, : vertices.shape[1]] = vertices
        rounded = np.round(self._frame.to_source(full), _DECIMALS) + 0.0  # no minus zero
        x, y, z = (map(repr, column) for column in rounded.T.tolist())
        return list(zip(x, y, z, strict=True))


def _places(*corners: CornerText) -> str:
    return "".join(f" 1{k}\n{x}\n 2{k}\n{y}\n 3{k}\n{z}\n" for k, (x, y, z) in enumerate(corners))


def _extended_data(texts: Sequence[str]) -> str:
    lines = "".join(f"1000\n{_plain(text)}\n" for text in texts)
    return f"1001\n{APPLICATION}\n{lines}"
