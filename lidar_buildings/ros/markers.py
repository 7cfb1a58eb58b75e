"""Solids and façades as markers for RViz."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.ros.stamps import header_of


def model_markers(
    stamp: int,
    buildings: Mapping[int, Iterable[Solid]],
    withdrawn: Iterable[int] = (),
    sigmas: Mapping[int, float | None] = MappingProxyType({}),
) -> MarkerArray:
    """
    Return the edges of each building's solids as a list of lines that replaces the one shown before.

    The marker of a building without solids, or of one that is withdrawn, is deleted. The less sure its
    corners are in plan, by a standard deviation [m], the fainter it is.
    """
    shown: dict[int, Iterable[Solid]] = {**dict.fromkeys(withdrawn, ()), **buildings}
    return MarkerArray(
        markers=[_marker(stamp, number, solids, sigmas.get(number)) for number, solids in shown.items()]
    )


def facade_markers(stamp: int, facades: Iterable[Facade], withdrawn: Iterable[int] = ()) -> MarkerArray:
    """
    Return the edges of each façade as a list of lines, the surer it is the more opaque.

    The marker of one that is withdrawn is deleted.
    """
    gone = [_lines(stamp, "facades", number, (), _FACADE) for number in withdrawn]
    shown = []
    for one in facades:
        ends = np.stack([one.ring, np.roll(one.ring, -1, axis=0)], axis=1).reshape(-1, 3)
        colour = ColorRGBA(r=_FACADE.r, g=_FACADE.g, b=_FACADE.b, a=one.confidence)
        shown.append(_lines(stamp, "facades", one.facade_id, ends.tolist(), colour))
    return MarkerArray(markers=[*gone, *shown])


#: Corners as sure as this are opaque [m]; the least that is seen of others.
_SURE, _FAINTEST = 0.05, 0.3
_FACADE = ColorRGBA(r=0.1, g=0.6, b=1.0, a=1.0)


def _marker(stamp: int, building_id: int, solids: Iterable[Solid], sigma: float | None) -> Marker:
    corners = [corner for solid in solids for corner in _edges(solid).tolist()]
    colour = ColorRGBA(r=1.0, g=0.6, b=0.1, a=max(_SURE / max(sigma or 0.0, _SURE), _FAINTEST))
    return _lines(stamp, "buildings", building_id, corners, colour)


def _lines(
    stamp: int, namespace: str, number: int, corners: Sequence[Sequence[float]], colour: ColorRGBA
) -> Marker:
    marker = Marker(
        header=header_of(stamp),
        ns=namespace,
        id=number - (number >> 31 << 32),  # a marker's id has a sign
        type=Marker.LINE_LIST,
        action=Marker.ADD if corners else Marker.DELETE,
        scale=Vector3(x=0.15),  # width of the lines [m]
        color=colour,
        points=[Point(x=x, y=y, z=z) for x, y, z in corners],
    )
    marker.pose.orientation.w = 1.0
    return marker


def _edges(solid: Solid) -> NDArray[np.float64]:
    """Return both ends of a solid's edges, each edge once, shape (2 n, 3)."""
    rings = [ring for face in solid.faces for ring in face]
    pairs = np.array([pair for ring in rings for pair in zip(ring, (*ring[1:], ring[0]), strict=True)])
    return solid.vertices[np.unique(np.sort(pairs, axis=1), axis=0).ravel()]
