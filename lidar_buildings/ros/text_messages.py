"""
Topics of text: JSON, the quality of outlines, and models as lines of CityJSONSeq, which carry no stamp.

A feature without city objects withdraws what had its id before. One that is named after a tile closes the
tile: all its features have been sent.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np
from std_msgs.msg import String

from lidar_buildings.core.model.bounds import MAX_STAMP, checked_id, checked_length, checked_stamp
from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.outline import BuildingOutline, OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.stages.facades.facade import Facade

#: Characters of a message; wide margin: the outlines of a tile take 200 each.
MAX_LENGTH = 20_000_000
#: Building id → quality of its outline, for all outlines of a tile.
Qualities = dict[int, OutlineQuality]
_LENGTHS = ("sigma", "max_offset", "bias")
_FEATURE = '{"type":"CityJSONFeature"'
_BEGIN, _END = f'{_FEATURE},"id":', ',"CityObjects":{},"vertices":[]}'
_CLOSING = f'{_BEGIN}"tile-'
_Said = TypeVar("_Said")


def read_json(topic: str, message: String, read: Callable[[Any], _Said]) -> _Said:
    """Return what `read` makes of a message's JSON; MessageError if it fails, or the text is too long."""
    text = message.data
    try:
        if len(text) > MAX_LENGTH:
            raise ValueError(f"{len(text)} characters: must be at most {MAX_LENGTH}")
        return read(json.loads(text))
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError) as error:
        raise MessageError(f"{topic} is not understood: {error!r}: {text[:100]}") from error


def quality_message(stamp: int, outlines: Iterable[BuildingOutline]) -> String:
    """Return how well a tile's outlines fit; a length that is not known is null."""
    found = {}
    for one in outlines:
        if (quality := one.quality) is not None:
            lengths = {name: float(getattr(quality, name)) for name in _LENGTHS}
            known = {name: value if np.isfinite(value) else None for name, value in lengths.items()}
            found[one.building_id] = {**known, "status": quality.status.value, "reason": quality.reason}
    return String(data=json.dumps({"stamp": stamp, "outlines": found}))


def qualities_of(message: String) -> tuple[int, Qualities]:
    """Return a tile's stamp [ns] and the quality of its outlines; MessageError if it is not understood."""

    def read(said: Any) -> tuple[int, Qualities]:
        found = {}
        for number, one in said["outlines"].items():
            lengths = (np.nan if one[name] is None else checked_length(name, one[name]) for name in _LENGTHS)
            sigma, max_offset, bias = lengths
            state = BuildingStatus(one["status"]), one["reason"]
            found[checked_id(number)] = OutlineQuality(sigma, max_offset, *state, bias)
        return checked_stamp(said["stamp"]), found

    return read_json("outline_quality", message, read)


def facades_message(stamp: int, facades: Iterable[Facade]) -> String:
    """Return all that is known of a tile's façades."""
    return String(data=json.dumps({"stamp": stamp, "facades": [one.record for one in facades]}))


def facades_of(message: String) -> tuple[int, tuple[Facade, ...]]:
    """Return a tile's stamp [ns] and its façades; MessageError if it is not understood."""

    def read(said: Any) -> tuple[int, tuple[Facade, ...]]:
        return checked_stamp(said["stamp"]), tuple(map(Facade.of_record, said["facades"]))

    return read_json("facade_records", message, read)


def withdrawal_message(readable_id: str) -> String:
    """Return the message that there is no building of this name any more."""
    return String(data=f"{_BEGIN}{json.dumps(readable_id)}{_END}")


def is_model(line: str) -> bool:
    """Whether a line is a feature with city objects: neither a header nor what `withdrawal_message` makes."""
    return line.startswith(_FEATURE) and not line.endswith(_END)


def is_provisional(line: str) -> bool:
    """Whether a feature was solved again since its tile was sent: no file has it (`pipeline.live_models`)."""
    return '"provisional":true' in line


def tile_closing_message(stamp: int) -> String:
    """Return the message that a tile has no more features."""
    return withdrawal_message(f"tile-{stamp}")


def closed_tile(line: str) -> int | None:
    """Return the stamp of the tile that a feature closes, None if it closes none."""
    number = line.removeprefix(_CLOSING).removesuffix(f'"{_END}')
    if not (line.startswith(_CLOSING) and number.isdecimal() and len(number) < 20):
        return None
    return int(number) if int(number) <= MAX_STAMP else None
