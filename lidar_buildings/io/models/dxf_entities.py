"""
A DXF drawing as text: what stands before and after its entities; faces, closed polylines with arcs, points.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.files.reference_systems import FOOT, US_SURVEY_FOOT, is_same_unit

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


class DxfEntities:
    """Writes entities one after the other, each with a handle of its own."""

    def __init__(self) -> None:
        self.next_handle = _FIRST_HANDLE

    def face(self, layer: str, corners: Sequence[CornerText], data: str, hidden: Sequence[bool]) -> str:
        """Return a face of three or four corners in one plane; edges to the next corner may be `hidden`."""
        # three corners are written as four, of which the last two are one
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners[:3]
        dx, dy, dz = corners[-1]
        mark = ""
        if any(hidden):
            # with three corners the last edge is the fourth, and the third has no length
            flags = sum(1 << k for k, one in enumerate(hidden[:-1]) if one) | 8 * hidden[-1]
            mark = f" 70\n{flags}\n"
        return (
            f"{self._begun('3DFACE', layer)}100\nAcDbFace\n 10\n{ax}\n 20\n{ay}\n 30\n{az}\n"
            f" 11\n{bx}\n 21\n{by}\n 31\n{bz}\n 12\n{cx}\n 22\n{cy}\n 32\n{cz}\n"
            f" 13\n{dx}\n 23\n{dy}\n 33\n{dz}\n{mark}{data}"
        )

    def closed_polyline(
        self, layer: str, corners: Sequence[CornerText], bulges: Sequence[float], elevation: float, data: str
    ) -> str:
        """
        Return a closed polyline of lines and arcs in a horizontal plane, its corners open.

        A bulge is the tangent of a quarter of a segment's angle, 0 for a line; `data` is what `extended_data`
        returns.
        """
        places = "".join(
            f" 10\n{x}\n 20\n{y}\n" + (f" 42\n{round(bulge, _DECIMALS_OF_BULGES)!r}\n" if bulge else "")
            for (x, y, _), bulge in zip(corners, bulges, strict=True)
        )
        begun = self._begun("LWPOLYLINE", layer)
        height = f" 38\n{coordinate_text(elevation)}\n"
        return f"{begun}100\nAcDbPolyline\n 90\n{len(corners)}\n 70\n1\n{height}{places}{data}"

    def line(self, layer: str, start: CornerText, end: CornerText, data: str) -> str:
        """Return a straight line."""
        (ax, ay, az), (bx, by, bz) = start, end
        begun = self._begun("LINE", layer)
        return (
            f"{begun}100\nAcDbLine\n 10\n{ax}\n 20\n{ay}\n 30\n{az}\n 11\n{bx}\n 21\n{by}\n 31\n{bz}\n{data}"
        )

    def point(self, layer: str, place: CornerText, data: str) -> str:
        """Return a point."""
        x, y, z = place
        begun = self._begun("POINT", layer)
        return f"{begun}100\nAcDbPoint\n 10\n{x}\n 20\n{y}\n 30\n{z}\n{data}"

    def extended_data(self, texts: Sequence[str]) -> str:
        """Return texts as the data of an entity."""
        lines = chain.from_iterable(("1000\n", _plain(text), "\n") for text in texts)
        return f"1001\n{APPLICATION}\n" + "".join(lines)

    def _begun(self, kind: str, layer: str) -> str:
        handle = self.next_handle
        self.next_handle += 1
        return f"  0\n{kind}\n  5\n{handle:X}\n330\n{_OWNER}\n100\nAcDbEntity\n  8\n{layer}\n"


def corner_texts(corners: NDArray[np.float64]) -> list[CornerText]:
    """Return corners, shape (n, 3), as text."""
    rounded = np.round(corners, _DECIMALS) + 0.0  # no minus zero
    x, y, z = (map(repr, column) for column in rounded.T.tolist())
    return list(zip(x, y, z, strict=True))


def coordinate_text(coordinate: float) -> str:
    """Return a coordinate as text, the same for the same value everywhere."""
    return repr(round(coordinate, _DECIMALS) + 0.0)  # no minus zero


def _plain(text: str) -> str:
    """Return a text on one line in ASCII; other characters are written by their number, as DXF has it."""
    line = " ".join(text.split())
    plain = "".join(c if c.isascii() else f"\\U+{ord(c):04X}" if ord(c) < 0x10000 else "?" for c in line)
    return plain[:_LONGEST_TEXT]


class DxfFrame(NamedTuple):
    """The text around the entities."""

    #: What to write before the first and behind the last entity.
    before: str
    after: str
    #: Where in `before` the next free handle stands, of eight digits: known when all entities are written.
    seed_at: int


def dxf_frame(metres_per_unit: float) -> DxfFrame:
    """Return the frame of a drawing, the same at any time; units that have no number stay unnamed."""
    unit, metric = next(
        (found for metres, found in _UNITS.items() if is_same_unit(metres, metres_per_unit)), (0, 1)
    )
    before, entities, after = EMPTY.read_text(encoding="ascii").partition(_ENTITIES)
    for name, value in (("MEASUREMENT", metric), ("INSUNITS", unit), ("HANDSEED", f"{_FIRST_HANDLE:X}")):
        before = re.sub(rf"(\${name}\n.*\n).*", rf"\g<1>{value}", before)
    return DxfFrame(before + entities, after, before.index(f"{_FIRST_HANDLE:X}"))
