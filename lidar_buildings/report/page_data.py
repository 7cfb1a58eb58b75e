"""Arrays within a page: deflated, as base64 text in elements that browsers keep and do not run."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.files.compact_json import compact_json

#: Fast: finer levels take four times as long for a twentieth of the size.
_LEVEL = 1


def array_element(name: str, array: NDArray[Any]) -> str:
    """
    Return the element that holds an array, little-endian, row by row.

    Parameters
    ----------
    name : str
        Ends the element's id, ``data-…``.
    array : ndarray
        Of whole numbers of 8, 16 or 32 bits, or float32.
    """
    values = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    shape = ",".join(map(str, array.shape))
    return _element(name, array.dtype.name, shape, values.tobytes())


def json_element(name: str, content: Mapping[str, Any]) -> str:
    """Return the element that holds what JSON can say."""
    return _element(name, "json", "", compact_json(content).encode())


def _element(name: str, kind: str, shape: str, content: bytes) -> str:
    text = base64.b64encode(zlib.compress(content, _LEVEL)).decode()
    facts = f'id="data-{name}" data-type="{kind}" data-shape="{shape}"'
    return f'<script type="text/plain" {facts}>{text}</script>'
