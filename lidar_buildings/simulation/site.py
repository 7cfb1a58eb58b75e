"""A building site: places things on terrain until the scene is complete."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from lidar_buildings.simulation import roof_shapes
from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.scene import Road, Tree, VirtualScene
from lidar_buildings.simulation.terrain import Terrain

#: Tries per tree or car before the site counts as full.
MAX_TRIES = 100


class Site:
    """Collects what stands on a rectangle of terrain; `random` is the only source of chance."""

    def __init__(self, size: tuple[float, float], terrain: Terrain, seed: int) -> None:
        self.size = size
        self.terrain = terrain
        self.random = np.random.default_rng(seed)
        self._buildings: list[Building] = []
        self._obstacles: list[Building] = []
        self._trees: list[Tree] = []
        self._roads: list[Road] = []

    @property
    def n_buildings(self) -> int:
        """How many stand there."""
        return len(self._buildings)

    def add_road(self, road: Road) -> None:
        """Lay a road."""
        self._roads.append(road)

    def add_building(self, shape: Building, x: float, y: float, rotation_deg: float = 0.0) -> None:
        """Stand a building on the mean elevation of the terrain along its outline."""
        self._buildings.append(
            replace(self._standing(shape, x, y, rotation_deg), number=len(self._buildings) + 1)
        )

    def add_row(self, houses: list[Building], x: float, y: float, rotation_deg: float) -> None:
        """Stand houses wall to wall in a row along their x axes, its middle at (x, y)."""
        widths = [float(np.ptp(house.exterior[:, 0])) for house in houses]
        left = -sum(widths) / 2
        direction = np.array([np.cos(np.deg2rad(rotation_deg)), np.sin(np.deg2rad(rotation_deg))])
        for house, width in zip(houses, widths, strict=True):
            middle = np.array([x, y]) + (left + width / 2) * direction
            self.add_building(house, float(middle[0]), float(middle[1]), rotation_deg)
            left += width

    def add_wall(self, x: float, y: float, rotation_deg: float) -> None:
        """Stand a free wall, 15 m long, 0.3 m thick and 2 m high."""
        shape = roof_shapes.flat(15.0, 0.3, 2.0)
        self._obstacles.append(replace(self._standing(shape, x, y, rotation_deg), roof_type="wall", number=0))

    def add_cars(self, n_cars: int) -> None:
        """Park cars along the roads."""
        for _ in range(n_cars):
            road = self._roads[self.random.integers(0, len(self._roads))]
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
        built = [building.polygon for building in self._buildings]
        paved = [shapely.LineString([road.start, road.end]).buffer(road.width / 2) for road in self._roads]
        taken = shapely.union_all([*built, *paved])
        shapely.prepare(taken)
        for _ in range(n_trees):
            for _ in range(MAX_TRIES):
                x, y = (float(self.random.uniform(0.02, 0.98) * extent) for extent in self.size)
                radius = float(self.random.uniform(1.8, 4.0))
                if not shapely.dwithin(taken, shapely.Point(x, y), radius + clearance):
                    self._plant(x, y, radius)
                    break

    def add_tree_over_eave(self, number: int) -> None:
        """Plant a tree beside a building's longest wall, its crown over the roof by 1.2 m."""
        ring = self._buildings[number - 1].exterior
        edges = np.roll(ring, -1, axis=0) - ring
        longest = int(np.argmax(np.hypot(*edges.T)))
        outward = np.array([edges[longest, 1], -edges[longest, 0]]) / np.hypot(*edges[longest])
        radius = float(self.random.uniform(2.0, 3.0))
        x, y = ring[longest] + edges[longest] / 2 + outward * (radius - 1.2)
        self._plant(float(x), float(y), radius, half_height=3.0)

    def scene(self, name: str) -> VirtualScene:
        """Return what was collected."""
        return VirtualScene(
            name=name,
            size=self.size,
            terrain=self.terrain,
            buildings=tuple(self._buildings),
            obstacles=tuple(self._obstacles),
            trees=tuple(self._trees),
            roads=tuple(self._roads),
        )

    def _standing(self, shape: Building, x: float, y: float, rotation_deg: float) -> Building:
        on_plan = shape.placed(x, y, rotation_deg)
        rim = shapely.segmentize(on_plan.polygon.exterior, 1.0)
        ground = float(self.terrain.at(shapely.get_coordinates(rim)[:-1]).mean())
        return shape.placed(x, y, rotation_deg, ground)

    def _plant(self, x: float, y: float, radius: float, half_height: float | None = None) -> None:
        """Plant a tree whose crown begins 2 m above the ground."""
        half = float(self.random.uniform(1.2, 1.7) * radius) if half_height is None else half_height
        ground = float(self.terrain.at(np.array([[x, y]]))[0])
        self._trees.append(Tree(x, y, ground + 2.0 + half, radius, half))
