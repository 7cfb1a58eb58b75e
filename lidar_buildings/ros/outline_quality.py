"""How well a tile's outlines fit, as one message: the rings' messages have no room for it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np
from std_msgs.msg import String

from lidar_buildings.core.model.outline import BuildingOutline, OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.ros.json_text import read_json

#: Building id → quality of its outline, for all outlines of a tile.
Qualities = dict[int, OutlineQuality]


def quality_message(stamp: int, outlines: Iterable[BuildingOutline]) -> String:
    """Return the quality of a tile's outlines as a line of JSON; a length that is not known is null."""
    found = {
        one.building_id: {
            "sigma": _or_none(one.quality.sigma),
            "max_offset": _or_none(one.quality.max_offset),
            "status": one.quality.status.value,
            "reason": one.quality.reason,
        }
        for one in outlines
        if one.quality is not None
    }
    return String(data=json.dumps({"stamp": stamp, "outlines": found}))


def qualities_of(message: String) -> tuple[int, Qualities]:
    """
    Return a tile's stamp [ns] and the quality of its outlines.

    MessageError if the text is not of the form that `quality_message` gives.
    """
    return read_json("outline_quality", message, _content_of)


def _content_of(said: Any) -> tuple[int, Qualities]:
    outlines = said["outlines"].items()
    qualities = {int(number): _quality_of(**members) for number, members in outlines}
    return int(said["stamp"]), qualities


def _quality_of(sigma: float | None, max_offset: float | None, status: str, reason: str) -> OutlineQuality:
    lengths = [np.nan if length is None else float(length) for length in (sigma, max_offset)]
    return OutlineQuality(*lengths, BuildingStatus(status), reason)


def _or_none(length: float) -> float | None:
    return float(length) if np.isfinite(length) else None
