"""What stands before and after the entities of a DXF file: header, tables and objects, made by ezdxf."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

from lidar_buildings.io.files.reference_systems import FOOT, US_SURVEY_FOOT, is_same_unit

#: AutoCAD 2000: the oldest version with light polylines and units, which everything reads.
_VERSION = "R2000"
#: Handle of the first entity; the frame's own are lower, and all that follow have eight digits, too.
FIRST_HANDLE = 0x10000000
#: Metres per unit → number of $INSUNITS (and whether the unit is metric).
_UNITS = {1.0: (6, 1), FOOT: (2, 0), US_SURVEY_FOOT: (21, 0)}
_ENTITIES = "  0\nSECTION\n  2\nENTITIES\n"
#: ezdxf's options belong to the whole process.
_one_writer = threading.Lock()


class DxfFrame(NamedTuple):
    """
    The text around the entities.

    Attributes
    ----------
    before, after : str
        What to write before the first and behind the last entity.
    owner : str
        Handle of the model space, to which all entities belong.
    seed_at : int
        Where in `before` the next free handle stands, of eight digits: known when all entities are written.
    """

    before: str
    after: str
    owner: str
    seed_at: int


def dxf_frame(layers: Mapping[str, int], application: str, metres_per_unit: float) -> DxfFrame:
    """
    Make the frame of a drawing, the same at any time.

    Parameters
    ----------
    layers : mapping
        Name → number of its colour.
    application : str
        Name under which entities carry data.
    metres_per_unit : float
        Of the coordinates; units that drawings have no number for stay unnamed.
    """
    unit, metric = next(
        (found for metres, found in _UNITS.items() if is_same_unit(metres, metres_per_unit)), (0, 1)
    )
    import ezdxf  # it takes half a second, which only a drawing is worth

    with _fixed_dates(ezdxf.options):
        drawing = ezdxf.new(_VERSION, units=unit)
        drawing.header["$MEASUREMENT"] = metric
        drawing.appids.add(application)
        for name, colour in layers.items():
            drawing.layers.add(name, color=colour)
        text = io.StringIO()
        drawing.write(text)
    before, entities, after = text.getvalue().partition(_ENTITIES)
    seed = "$HANDSEED\n  5\n"
    before = before.replace(f"{seed}{drawing.entitydb.handles}\n", f"{seed}{FIRST_HANDLE:X}\n")
    place = before.index(seed) + len(seed)
    return DxfFrame(before + entities, after, drawing.modelspace().layout_key, place)


@contextmanager
def _fixed_dates(options: Any) -> Iterator[None]:
    """Let ezdxf write fixed dates and identifiers, so that equal content gives equal bytes."""
    with _one_writer:
        before = options.write_fixed_meta_data_for_testing
        options.write_fixed_meta_data_for_testing = True
        try:
            yield
        finally:
            options.write_fixed_meta_data_for_testing = before
