"""A virtual scene: everything the scanner can hit, and where it lies on the earth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.terrain import Terrain

#: Where the scenes lie: UTM zone 32 on ETRS89, 100 m lines through the origin.
FRAME = MapFrame("EPSG:25832", (565_000.0, 5_930_000.0, 0.0))


@dataclass(frozen=True)
class Tree:
    """A tree whose crown is an ellipsoid; its trunk is never hit."""

    #: Position [m].
    x: float
    y: float
    crown_elevation: float  #: elevation of the crown's middle [m]
    #: Semi-axes of the crown [m].
    crown_radius: float
    crown_half_height: float


@dataclass(frozen=True)
class Road:
    """A straight road on the terrain."""

    #: Ends of its axis [m].
    start: tuple[float, float]
    end: tuple[float, float]
    width: float = 6.0  #: [m]


@dataclass(frozen=True, eq=False)
class VirtualScene:
    """A rectangle from the origin of the map frame, and what stands on it."""

    name: str
    size: tuple[float, float]  #: extent along x and y [m]
    terrain: Terrain
    buildings: tuple[Building, ...] = ()  #: numbered from 1
    #: Cars and free-standing walls, numbered 0: neither ground nor building.
    obstacles: tuple[Building, ...] = ()
    trees: tuple[Tree, ...] = ()
    roads: tuple[Road, ...] = ()  #: ground of another brightness
    frame: MapFrame = FRAME

    def blocks(self) -> NDArray[np.int64]:
        """Number, per building, of the block of touching buildings to which it belongs, from 1."""
        union = shapely.union_all([b.polygon.buffer(0.05, join_style="mitre") for b in self.buildings])
        blocks = shapely.get_parts(union)
        inside = [shapely.point_on_surface(b.polygon) for b in self.buildings]
        raw = np.array(
            [np.flatnonzero(shapely.contains(blocks, point))[0] for point in inside], dtype=np.int64
        )
        _, first, position = np.unique(raw, return_index=True, return_inverse=True)
        return np.argsort(np.argsort(first))[position] + 1
