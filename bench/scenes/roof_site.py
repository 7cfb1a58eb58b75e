"""
A piece of town under the scanner, with leaning beams and several returns: what roof_scenes.py builds from.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.scenes.roof_site_beams import Array, Elevation, World
from bench.scenes.roof_site_echoes import Crown, Hits, Sheet, returns_of

#: Elevation of level ground [m].
GROUND = 20.0
#: What a return is: bare ground, roof (with all that belongs to the building upon it), wall, plant, any other
#: object, or what both answers are right for.
BARE, ROOF, WALL, PLANT, OBJECT, EITHER = range(6)
#: Mean brightness by kind; roofs differ from one another.
BRIGHTNESS = np.array([650.0, 400.0, 350.0, 500.0, 800.0, 400.0])


class RoofScene(NamedTuple):
    """Points, what the scan says of them, and what is true."""

    points: Array  #: [m], shape (n, 3)
    #: What `select_roofs` is given: `height_above_ground` and `classification` (2 = ground, 1) are exact;
    #: `return_number`, `number_of_returns` and `intensity` where the scene has them.
    columns: dict[str, NDArray[Any]]
    #: Roofs with their chimneys, dormers, parapets and machines; neither walls nor plants nor what stands
    #: free. Shape (n,).
    is_building: NDArray[np.bool_]
    is_facade: NDArray[np.bool_]  #: outer walls of buildings, which are not roof, shape (n,)
    #: False where both answers are right: inner walls of roofs, balconies, tanks, shape (n,).
    is_judged: NDArray[np.bool_]


class Box(NamedTuple):
    """A rectangle about a middle [m], its length turned from x by an angle."""

    x: float
    y: float
    length: float
    width: float
    angle_deg: float = 0.0

    def local(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return positions along and across from the middle."""
        angle = np.deg2rad(self.angle_deg)
        dx, dy = x - self.x, y - self.y
        return np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx

    def depth(self, x: Array, y: Array) -> Array:
        """How deep positions lie inside; negative outside."""
        along, across = self.local(x, y)
        return np.minimum(self.length / 2 - abs(along), self.width / 2 - abs(across))

    def extent(self) -> tuple[float, float, float]:
        """Middle, and how far from it the shape reaches."""
        return self.x, self.y, float(np.hypot(self.length, self.width)) / 2


class Disc(NamedTuple):
    """A circle [m]."""

    x: float
    y: float
    radius: float

    def depth(self, x: Array, y: Array) -> Array:
        """How deep positions lie inside; negative outside."""
        return self.radius - np.hypot(x - self.x, y - self.y)

    def extent(self) -> tuple[float, float, float]:
        """Middle, and how far from it the shape reaches."""
        return self.x, self.y, self.radius


class Hollow(NamedTuple):
    """A shape without another one: a courtyard."""

    shape: Box | Disc
    court: Box | Disc

    def depth(self, x: Array, y: Array) -> Array:
        """How deep positions lie inside; negative outside."""
        return np.minimum(self.shape.depth(x, y), -self.court.depth(x, y))

    def extent(self) -> tuple[float, float, float]:
        """Middle, and how far from it the shape reaches."""
        return self.shape.extent()


Shape = Box | Disc | Hollow


class RoofSite:
    """Terrain of `width` × `depth`, what is put upon it, and pulses of `density` [pts/m²] in rows along x."""

    def __init__(
        self, width: float, depth: float, density: float, seed: int, elevation: Elevation | None = None
    ):
        self.random = np.random.default_rng(seed)
        self.size = np.array([width, depth])
        self.density = density
        self.world = World(lambda x, y: GROUND + (0 * x if elevation is None else elevation(x, y)))
        self.crowns: list[Crown] = []
        self.sheets: list[Sheet] = []
        self.lost: list[tuple[Shape, float]] = []

    def level(self, x: float, y: float) -> float:
        """Elevation of the terrain at a place."""
        return float(self.world.terrain(np.array([x]), np.array([y]))[0])

    def put(self, shape: Shape, top: Elevation | float, kind: int = ROOF) -> None:
        """Put something solid; of several the highest is seen."""
        self.world.add(shape, top if callable(top) else (lambda x, y: top + 0 * x), kind)

    def house(
        self,
        x: float,
        y: float,
        length: float,
        width: float,
        eave: float,
        pitch_deg: float = 35.0,
        angle_deg: float = 0.0,
        roof: str = "gable",
    ) -> Box:
        """Put a house: its eaves are so high above the terrain in its middle."""
        box, base, rise = (
            Box(x, y, length, width, angle_deg),
            self.level(x, y) + eave,
            np.tan(np.deg2rad(pitch_deg)),
        )
        rises: dict[str, Elevation] = {
            "flat": lambda x, y: 0 * x,
            "gable": lambda x, y: rise * (width / 2 - abs(box.local(x, y)[1])),
            "hip": lambda x, y: rise * box.depth(x, y),
            "shed": lambda x, y: rise * (width / 2 + box.local(x, y)[1]),
            "barrel": lambda x, y: rise * np.sqrt(np.clip(width**2 / 4 - box.local(x, y)[1] ** 2, 0, None)),
        }
        self.put(box, lambda x, y: base + rises[roof](x, y))
        return box

    def tree(
        self, x: float, y: float, radius: float, height: float, crown: float = 0.7, **leaves: float
    ) -> None:
        """Plant a tree whose crown is the upper part of its height."""
        half = crown * height / 2
        self.crowns.append(Crown(x, y, self.level(x, y) + height - half, radius, half, PLANT, **leaves))

    def hang(self, shape: Shape, elevation: float, echo: float, passes: float, kind: int = OBJECT) -> None:
        """Hang a sheet that gives an echo with one probability, and then lets light pass with another."""
        self.sheets.append(Sheet(shape, elevation, echo, passes, kind))

    def lose(self, shape: Shape, share: float) -> None:
        """Leave a share of the pulses that end within a shape, and not on the ground, without any return."""
        self.lost.append((shape, share))

    def scanned(
        self, noise: float, rotation_deg: float, *, max_angle_deg: float = 12.0, returns: bool = True
    ) -> RoofScene:
        """
        Measure, and turn the whole site about its middle.

        `noise` is σ along each axis. Two strips see the site from either side, row by row, under angles that
        grow from a third of the largest one at y = 0 to it; with no angle all beams are upright.
        """
        x, y, strip = self._feet(np.tan(np.deg2rad(max_angle_deg)))
        lean = strip * np.tan(np.deg2rad(max_angle_deg)) * (1 + 2 * np.clip(y / self.size[1], 0, 1)) / 3
        hits = returns_of(self.world, self.crowns, self.sheets, x, y, lean, self.random)
        last = np.arange(len(hits.of)) + hits.of - hits.number
        kind = np.where(hits.is_wall, self._wall_kinds(hits), hits.kind)
        # Whole pulses, by where they end.
        kept = ((hits.points[last, :2] >= 0) & (hits.points[last, :2] < self.size)).all(axis=1)
        for shape, share in self.lost:
            inside = (shape.depth(*hits.points[:, :2].T) > 0) & (kind != BARE)
            kept &= ~inside | (self.random.random(len(kind)) >= share)
        points = hits.points + self.random.normal(0, 1, hits.points.shape) * noise
        columns = {
            "height_above_ground": points[:, 2] - self.world.terrain(*points[:, :2].T),
            "classification": np.where(kind == BARE, 2, 1).astype(np.uint8),
        }
        if returns:
            columns["return_number"], columns["number_of_returns"] = hits.number, hits.of
            shade = 0.8 + 0.08 * (hits.layer % 6)
            columns["intensity"] = (
                BRIGHTNESS[kind] * shade * self.random.uniform(0.9, 1.1, len(kind))
            ) / hits.of
        columns = {name: column[kept] for name, column in columns.items()}
        kind = kind[kept]
        return RoofScene(
            self._turned(points[kept], rotation_deg), columns, kind == ROOF, kind == WALL, kind != EITHER
        )

    def _feet(self, lean: float) -> tuple[Array, Array, Array]:
        """
        Where beams meet level ground: one somewhere in every square of 1/density; and from which side, ±1.
        """
        spacing = 1 / np.sqrt(self.density)
        beyond = int(np.ceil(lean * self.world.relief(*self.size) / spacing))
        columns, rows = np.ceil(self.size / spacing).astype(int)
        cell = np.stack(np.meshgrid(np.arange(columns), np.arange(-beyond, rows + beyond)), axis=-1)
        cell = cell.reshape(-1, 2)
        x, y = ((cell + self.random.random(cell.shape)) * spacing).T
        return x, y, 1 - 2.0 * (cell[:, 1] % 2)

    @staticmethod
    def _wall_kinds(hits: Hits) -> NDArray[np.int64]:
        """Walls of buildings are walls; over another roof, or just below the eave, both answers are right."""
        kind = np.where(hits.kind == ROOF, WALL, hits.kind)
        unclear = (hits.kind == ROOF) & ((hits.foot_kind == ROOF) | (hits.below_top < 0.5))
        return np.where(unclear, EITHER, kind)

    def _turned(self, points: Array, rotation_deg: float) -> Array:
        """Turn about the middle."""
        angle = np.deg2rad(rotation_deg)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return np.column_stack(((points[:, :2] - self.size / 2) @ turn + self.size / 2, points[:, 2]))
