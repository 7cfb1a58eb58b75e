"""The colours of a view, those of the page: red, green and blue from 0 to 1."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def _rgb(text: str) -> NDArray[np.float64]:
    return np.array([[int(one[k : k + 2], 16) for k in (0, 2, 4)] for one in text.split()]) / 255


WALL, FOOT, EDGE, NONE, TERRAIN, OUTLINE, EDGE_POINT = _rgb(
    "e8e3d8 a7a79c 30363e c3c8cd cfd2bd 1b1f6a d3261e"
)
SLOPES = _rgb("f6e6b4 f0b873 df7d50 b3453b 6e2440")
#: Slope that has the last of these.
STEEP_DEG = 60.0
HEIGHTS = _rgb("30408f 2f8fb3 5fc08a e0d65c d8653a")
GREYS = _rgb("202020 f4f4f4")
#: By ASPRS class.
CLASSES = np.tile(_rgb("b9b9b9"), (256, 1))
CLASSES[[2, 3, 4, 5, 6, 9, 10, 11, 17]] = _rgb(
    "a98a64 a8cf7a 74b35a 3f8a43 d1503f 3d85c6 7a6a8a 8d8f94 c79a3e"
)
_PALETTE = _rgb("4e79a7 f28e2b 59a14f b07aa1 76b7b2 edc948 e15759 9c755f ff9da7 86bcb6 d4a6c8 8cd17d")


def ramp(stops: NDArray[np.float64], shares: NDArray[Any]) -> NDArray[np.float64]:
    """Return the colours at places from 0 to 1 along a row of colours."""
    places = np.clip(shares, 0, 1) * (len(stops) - 1)
    return np.stack([np.interp(places, np.arange(len(stops)), one) for one in stops.T], axis=-1)


def numbered(numbers: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return a colour for each number."""
    return _PALETTE[numbers % len(_PALETTE)]
