"""A virtual scene: everything that the scanner can hit, where it lies, and the site on which it is built."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.simulation import roof_shapes
from lidar_buildings.simulation.building import Building


@dataclass(frozen=True)
class Wave:
    """One sine wave of the terrain."""

    amplitude: float  #: [m]
    wavelength: float  #: [m]
    direction_deg: float = 0.0  #: direction in which it runs, counter-clockwise from x
    phase: float = 0.0  #: [rad]


@dataclass(frozen=True)
class Terrain:
    """Ground whose elevation is known everywhere."""

    elevation: float = 0.0  #: at the origin, without the waves [m]
    slope: tuple[float, float] = (0.0, 0.0)  #: rise per metre along x and y
    waves: tuple[Wave, ...] = ()  #: what is added to the slope

    def coefficients(self) -> NDArray[np.float64]:
        """Return (elevation, slope x, slope y, 0), then amplitude, wave numbers x and y, phase per wave."""
        rows = [(self.elevation, *self.slope, 0.0)]
        for wave in self.waves:
            number, direction = 2 * np.pi / wave.wavelength, np.deg2rad(wave.direction_deg)
            rows.append((wave.amplitude, number * np.cos(direction), number * np.sin(direction), wave.phase))
        return np.array(rows)

    def at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Elevation [m] at positions of shape (n, 2)."""
        return _elevations(np.ascontiguousarray(xy, dtype=np.float64), self.coefficients())


@kernel
def terrain_elevation(x, y, coefficients):
    """Elevation at one position [m]; `coefficients` as `Terrain.coefficients` gives them."""
    z = coefficients[0, 0] + coefficients[0, 1] * x + coefficients[0, 2] * y
    for row in range(1, len(coefficients)):
        angle = coefficients[row, 1] * x + coefficients[row, 2] * y + coefficients[row, 3]
        z += coefficients[row, 0] * np.sin(angle)
    return z


@kernel
def _elevations(xy, coefficients):
    """Elevation at many positions [m]."""
    z = np.empty(len(xy))
    for row in range(len(xy)):
        z[row] = terrain_elevation(xy[row, 0], xy[row, 1], coefficients)
    return z


#: Where the scenes lie: UTM zone 32 on ETRS89, 100 m lines through the origin.
FRAME = MapFrame("EPSG:25832", (565_000.0, 5_930_000.0, 0.0))


@dataclass(frozen=True)
class Tree:
    """A tree whose crown is an ellipsoid; its trunk is never hit."""

    x: float  #: [m]
    y: float  #: [m]
    crown_elevation: float  #: elevation of the crown's middle [m]
    crown_radius: float  #: semi-axes of the crown [m]
    crown_half_height: float


@dataclass(frozen=True)
class Road:
    """A straight road on the terrain."""

    start: tuple[float, float]  #: of its axis [m]
    end: tuple[float, float]  #: of its axis [m]
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
    #: Whether roofs hang over, and walls have windows and doors.
    is_detailed: bool = False

    def streets(self) -> shapely.Geometry:
        """Axes of all roads; where there is none, the scene's middle."""
        lines = [shapely.LineString([road.start, road.end]) for road in self.roads]
        return shapely.union_all(lines) if lines else shapely.Point(self.size[0] / 2, self.size[1] / 2)

    def blocks(self) -> NDArray[np.int64]:
        """Number, per building, of the block of touching buildings to which it belongs, from 1."""
        union = shapely.union_all([b.polygon.buffer(0.05, join_style="mitre") for b in self.buildings])
        blocks = shapely.get_parts(union)
        inside = [shapely.point_on_surface(b.polygon) for b in self.buildings]
        raw = [np.flatnonzero(shapely.contains(blocks, point))[0] for point in inside]
        _, first, position = np.unique(raw, return_index=True, return_inverse=True)
        return np.argsort(np.argsort(first))[position] + 1


#: Tries per tree or car before the site counts as full.
MAX_TRIES = 100


class Site:
    """Collects what stands on a rectangle of terrain; `random` is the only source of chance."""

    def __init__(self, size: tuple[float, float], terrain: Terrain, seed: int) -> None:
        self.size = size
        self.terrain = terrain
        self.random = np.random.default_rng(seed)
        self.lift = 0.0  #: of what is placed next above the terrain, as on a pavement [m]
        self.buildings: list[Building] = []
        self.roads: list[Road] = []
        self._obstacles: list[Building] = []
        self._trees: list[Tree] = []

    def add_building(self, shape: Building, x: float, y: float, rotation_deg: float = 0.0) -> None:
        """Stand a building on the mean elevation of the terrain along its outline."""
        standing = self._standing(shape, x, y, rotation_deg)
        self.buildings.append(replace(standing, number=len(self.buildings) + 1))

    def add_row(self, houses: list[Building], x: float, y: float, rotation_deg: float) -> None:
        """Stand houses wall to wall in a row along their x axes, its middle at (x, y)."""
        widths = [float(np.ptp(house.exterior[:, 0])) for house in houses]
        left = -sum(widths) / 2
        direction = np.array([np.cos(np.deg2rad(rotation_deg)), np.sin(np.deg2rad(rotation_deg))])
        for house, width in zip(houses, widths, strict=True):
            middle = np.array([x, y]) + (left + width / 2) * direction
            self.add_building(house, float(middle[0]), float(middle[1]), rotation_deg)
            left += width

    def add_obstacle(self, shape: Building, x: float, y: float, rotation_deg: float = 0.0) -> bool:
        """Stand an obstacle where it meets no building and no other obstacle; whether it does."""
        standing = replace(self._standing(shape, x, y, rotation_deg), number=0)
        taken = [one for one in (*self.buildings, *self._obstacles) if one.roof_type != "pavement"]
        is_free = not any(standing.polygon.intersects(one.polygon) for one in taken)
        if is_free or shape.roof_type == "pavement":
            self._obstacles.append(standing)
        return is_free

    def add_wall(self, x: float, y: float, rotation_deg: float) -> None:
        """Stand a free wall, 15 m long, 0.3 m thick and 2 m high."""
        shape = roof_shapes.flat(15.0, 0.3, 2.0)
        self._obstacles.append(replace(self._standing(shape, x, y, rotation_deg), roof_type="wall", number=0))

    def add_cars(self, n_cars: int) -> None:
        """Park cars along the roads."""
        for _ in range(n_cars):
            road = self.roads[self.random.integers(0, len(self.roads))]
            start, end = np.array(road.start), np.array(road.end)
            along = (end - start) / np.hypot(*(end - start))
            aside = np.array([-along[1], along[0]]) * (road.width / 2 - 1.2) * self.random.choice([-1, 1])
            x, y = start + self.random.uniform(0.02, 0.98) * (end - start) + aside
            shape = roof_shapes.flat(4.4, 1.8, 1.5)
            turn = float(np.rad2deg(np.arctan2(along[1], along[0])))
            car = replace(self._standing(shape, float(x), float(y), turn), roof_type="car", number=0)
            if not any(car.polygon.intersects(other.polygon) for other in self._obstacles):
                self._obstacles.append(car)

    def add_trees(self, n_trees: int, clearance: float) -> None:
        """Plant trees off the roads whose crowns keep this distance from all buildings [m]."""
        built = [building.polygon for building in self.buildings]
        paved = [shapely.LineString([road.start, road.end]).buffer(road.width / 2) for road in self.roads]
        taken = shapely.union_all([*built, *paved])
        shapely.prepare(taken)
        for _ in range(n_trees):
            for _ in range(MAX_TRIES):
                x, y = (float(self.random.uniform(0.02, 0.98) * extent) for extent in self.size)
                radius = float(self.random.uniform(1.8, 4.0))
                if not shapely.dwithin(taken, shapely.Point(x, y), radius + clearance):
                    self.plant(x, y, radius)
                    break

    def add_tree_over_eave(self, number: int) -> None:
        """Plant a tree beside a building's longest wall, its crown over the roof by 1.2 m."""
        ring = self.buildings[number - 1].exterior
        edges = np.roll(ring, -1, axis=0) - ring
        longest = int(np.argmax(np.hypot(*edges.T)))
        outward = np.array([edges[longest, 1], -edges[longest, 0]]) / np.hypot(*edges[longest])
        radius = float(self.random.uniform(2.0, 3.0))
        x, y = ring[longest] + edges[longest] / 2 + outward * (radius - 1.2)
        self.plant(float(x), float(y), radius, half_height=3.0)

    def scene(self, name: str) -> VirtualScene:
        """Return what was collected."""
        standing = (self.buildings, self._obstacles, self._trees, self.roads)
        return VirtualScene(name, self.size, self.terrain, *map(tuple, standing))

    def _standing(self, shape: Building, x: float, y: float, rotation_deg: float) -> Building:
        on_plan = shape.placed(x, y, rotation_deg)
        rim = shapely.segmentize(on_plan.polygon.exterior, 1.0)
        ground = float(self.terrain.at(shapely.get_coordinates(rim)[:-1]).mean())
        return shape.placed(x, y, rotation_deg, ground + self.lift)

    def plant(self, x: float, y: float, radius: float, half_height: float | None = None) -> None:
        """Plant a tree whose crown begins 2 m above the ground."""
        half = float(self.random.uniform(1.2, 1.7) * radius) if half_height is None else half_height
        ground = float(self.terrain.at(np.array([[x, y]]))[0])
        self._trees.append(Tree(x, y, ground + 2.0 + half, radius, half))
