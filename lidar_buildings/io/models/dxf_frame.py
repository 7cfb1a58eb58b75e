"""What stands before and after the entities of a DXF file: header, tables and objects."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from lidar_buildings.io.files.reference_systems import FOOT, US_SURVEY_FOOT, is_same_unit

#: A drawing without entities; written by ``python -m bench.common.empty_drawing`` with ezdxf, whose import
#: alone takes longer than most drawings.
EMPTY = Path(__file__).with_name("empty_drawing.dxf")
#: Handle of the model space in it, to which all entities belong.
OWNER = "17"
#: Handle of the first entity; the frame's own are lower, and all that follow have eight digits, too.
FIRST_HANDLE = 0x10000000
#: Metres per unit → number of $INSUNITS (and whether the unit is metric).
_UNITS = {1.0: (6, 1), FOOT: (2, 0), US_SURVEY_FOOT: (21, 0)}
_ENTITIES = "  0\nSECTION\n  2\nENTITIES\n"


class DxfFrame(NamedTuple):
    """
    The text around the entities.

    Attributes
    ----------
    before, after : str
        What to write before the first and behind the last entity.
    seed_at : int
        Where in `before` the next free handle stands, of eight digits: known when all entities are written.
    """

    before: str
    after: str
    seed_at: int


def dxf_frame(metres_per_unit: float) -> DxfFrame:
    """
    Return the frame of a drawing, the same at any time.

    Parameters
    ----------
    metres_per_unit : float
        Of the coordinates; units that drawings have no number for stay unnamed.
    """
    unit, metric = next(
        (found for metres, found in _UNITS.items() if is_same_unit(metres, metres_per_unit)), (0, 1)
    )
    before, entities, after = EMPTY.read_text(encoding="ascii").partition(_ENTITIES)
    for name, value in (("MEASUREMENT", metric), ("INSUNITS", unit), ("HANDSEED", f"{FIRST_HANDLE:X}")):
        before = re.sub(rf"(\${name}\n.*\n).*", rf"\g<1>{value}", before)
    return DxfFrame(before + entities, after, before.index(f"{FIRST_HANDLE:X}"))
