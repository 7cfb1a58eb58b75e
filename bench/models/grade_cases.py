"""Roofs as a survey may have seen them badly: points and outlines with what is wrong with them."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import rotate, translate

from bench.generalise.corners import FOLDER, drawn_roofs
from bench.models.grade_truth import RoofTruth, drawn_truth, largest_part, truth_of
from bench.scenes.models import GROUND, SHAPES, ModelScene, model_scene
from lidar_buildings.core.model.outline import Outline

#: Densities that a roof is seen with [points/m²], and noise of the heights [m].
DENSITIES, NOISES = (1.0, 2.0, 4.0, 8.0, 16.0), (0.02, 0.03, 0.05)
#: Fewest points of a case.
MIN_POINTS = 12
#: Smallest footprint [m²].
_SMALLEST = 4.0
#: So far around a footprint the ground was seen, too [m].
_GROUND_AROUND = 4.0


class Roof(NamedTuple):
    """A roof and what is known of it."""

    name: str
    points: NDArray[np.float64]  #: of the roof alone [m], shape (n_points, 3)
    truth: RoofTruth
    ground: float  #: elevation under it [m]


class Case(NamedTuple):
    """A roof as it was seen, and the outline that is given, if one is."""

    name: str
    kind: str
    points: NDArray[np.float64]
    truth: RoofTruth
    ground: float
    outline: Outline | None  #: to be used as it is; None: to be traced

    @property
    def ground_points(self) -> NDArray[np.float64]:
        """The ground around the building, as dense as the roof was seen, shape (n, 3) [m]."""
        plan = self.truth.plan
        around = plan if self.outline is None else plan | self.outline.polygon
        density = len(self.points) / plan.area
        west, south, east, north = around.buffer(_GROUND_AROUND).bounds
        chance = np.random.default_rng(zlib.crc32(f"{self.name} {self.kind} {len(self.points)}".encode()))
        n = int(density * (east - west) * (north - south))
        xy = chance.uniform((west, south), (east, north), (n, 2))
        xy = xy[~shapely.contains_xy(plan, *xy.T)]
        return np.column_stack([xy, np.full(len(xy), self.ground)])


def _largest(plan: shapely.Geometry) -> shapely.Polygon:
    return max(shapely.get_parts(plan), key=lambda one: one.area)


class _Seen(NamedTuple):
    """What is disturbed: the points, and the outline as somebody else has it."""

    points: NDArray[np.float64]
    plan: shapely.Polygon
    chance: np.random.Generator

    @property
    def spacing(self) -> float:
        return math.sqrt(self.plan.area / max(len(self.points), 1))

    @property
    def size(self) -> float:
        return math.sqrt(self.plan.area)

    def kept(self, rows: NDArray[np.bool_]) -> _Seen:
        return self._replace(points=self.points[rows])

    def on(self, plan: shapely.Geometry) -> _Seen:
        """Return the same on the largest part of another plan, unless hardly anything is left."""
        return self if plan.area < _SMALLEST else self._replace(plan=_largest(plan))

    def somewhere(self) -> NDArray[np.float64]:
        return self.points[self.chance.integers(len(self.points)), :2]


def _plain(seen: _Seen) -> _Seen:
    return seen


def _disc(seen: _Seen) -> _Seen:
    """No points within a disc of a tenth to a third of the plan's side."""
    radius = seen.size * seen.chance.uniform(0.1, 0.35)
    return seen.kept(np.hypot(*(seen.points[:, :2] - seen.somewhere()).T) > radius)


def _strip(seen: _Seen) -> _Seen:
    """No points within a strip, as between flight lines."""
    angle, width = seen.chance.uniform(0.0, math.pi), seen.size * seen.chance.uniform(0.1, 0.5)
    across = (seen.points[:, :2] - seen.somewhere()) @ (-math.sin(angle), math.cos(angle))
    return seen.kept(np.abs(across) > 0.5 * width)


def _half(seen: _Seen) -> _Seen:
    """No points beyond a line, as at the edge of the data or behind something high."""
    angle = seen.chance.uniform(0.0, 2.0 * math.pi)
    along = seen.points[:, :2] @ (math.cos(angle), math.sin(angle))
    return seen.kept(along < np.quantile(along, seen.chance.uniform(0.3, 0.95)))


def _noise(seen: _Seen) -> _Seen:
    """Heights that scatter by 0.1 to 0.6 m."""
    points = seen.points.copy()
    points[:, 2] += seen.chance.normal(0.0, seen.chance.uniform(0.1, 0.6), len(points))
    return seen._replace(points=points)


def _outliers(seen: _Seen) -> _Seen:
    """Of the points 1 to 15 % lie metres above or below."""
    points, share = seen.points.copy(), seen.chance.uniform(0.01, 0.15)
    is_out = seen.chance.random(len(points)) < share
    points[is_out, 2] += seen.chance.uniform(0.5, 5.0, is_out.sum()) * seen.chance.choice([-1.0, 1.0])
    return seen._replace(points=points)


def _tree(seen: _Seen) -> _Seen:
    """A crown over a corner, taken for roof; it hides most of what is under it."""
    ring = shapely.get_coordinates(seen.plan.exterior)[:-1]
    corner, radius = ring[seen.chance.integers(len(ring))], seen.size * seen.chance.uniform(0.1, 0.35)
    is_under = np.hypot(*(seen.points[:, :2] - corner).T) < radius
    top = float(np.median(seen.points[:, 2])) + seen.chance.uniform(0.0, 3.0)
    direction = seen.chance.normal(size=(int(math.pi * (radius / seen.spacing) ** 2), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    far = radius * seen.chance.random((len(direction), 1)) ** (1 / 3)
    kept = seen.points[~is_under | (seen.chance.random(len(seen.points)) < 0.3)]
    return seen._replace(points=np.concatenate([kept, np.append(corner, top) + far * direction]))


def _rows(seen: _Seen) -> _Seen:
    """Rows three to eight times as far apart as points along them."""
    angle, every = seen.chance.uniform(0.0, math.pi), seen.chance.integers(3, 9)
    across = seen.points[:, :2] @ (-math.sin(angle), math.cos(angle))
    return seen.kept(np.floor(across / seen.spacing) % every == 0)


def _thin(seen: _Seen) -> _Seen:
    """A tenth to a third of the points."""
    return seen.kept(seen.chance.random(len(seen.points)) < seen.chance.uniform(0.1, 0.35))


def _stripes(seen: _Seen) -> _Seen:
    """No points in stripes 0.5 to 2 m wide, 2 to 5 m apart."""
    angle, gap = seen.chance.uniform(0.0, math.pi), seen.chance.uniform(0.5, 2.0)
    across = seen.points[:, :2] @ (-math.sin(angle), math.cos(angle))
    return seen.kept(across % (gap + seen.chance.uniform(1.5, 3.0)) > gap)


def _strips(seen: _Seen) -> _Seen:
    """A second strip over a part, 0.1 to 1 m higher."""
    angle = seen.chance.uniform(0.0, 2.0 * math.pi)
    along = seen.points[:, :2] @ (math.cos(angle), math.sin(angle))
    rows = along > np.quantile(along, seen.chance.uniform(0.3, 0.9))
    jitter = seen.chance.normal(0.0, 0.3 * seen.spacing, (int(rows.sum()), 3)) * (1.0, 1.0, 0.0)
    again = seen.points[rows] + jitter + (0.0, 0.0, seen.chance.uniform(0.1, 1.0))
    return seen._replace(points=np.concatenate([seen.points, again]))


def _clumps(seen: _Seen) -> _Seen:
    """Points in clumps, as of beams that are reflected here and there."""
    n = max(int(len(seen.points) * 0.02), 4)
    middles = seen.points[seen.chance.integers(len(seen.points), size=n), :2]
    away = np.min(np.hypot(*(seen.points[:, None, :2] - middles).transpose(2, 0, 1)), axis=1)
    return seen.kept(away < seen.chance.uniform(1.5, 4.0) * seen.spacing)


def _merged(seen: _Seen) -> _Seen:
    """A footprint that has a neighbour's ground in it on two sides."""
    box = shapely.box(*seen.plan.bounds)
    return seen.on(box.buffer(seen.chance.uniform(0.0, 1.0), join_style="mitre"))


def _shifted(seen: _Seen) -> _Seen:
    """A footprint 0.3 to 3 m beside the building."""
    angle, far = seen.chance.uniform(0.0, 2.0 * math.pi), seen.chance.uniform(0.3, 3.0)
    return seen._replace(plan=translate(seen.plan, far * math.cos(angle), far * math.sin(angle)))


def _resized(seen: _Seen) -> _Seen:
    """A footprint drawn too wide or too narrow."""
    far = seen.chance.choice([-1.0, 1.0]) * seen.chance.uniform(0.2, 1.5)
    return seen.on(seen.plan.buffer(far, join_style="mitre"))


def _turned(seen: _Seen) -> _Seen:
    """A footprint turned by 3 to 20°."""
    return seen.on(rotate(seen.plan, seen.chance.choice([-1.0, 1.0]) * seen.chance.uniform(3.0, 20.0)))


def _extended(seen: _Seen) -> _Seen:
    """A footprint with a wing that does not stand, or lacking a part that does."""
    west, south, east, north = seen.plan.bounds
    x, y = seen.chance.uniform(west, east), seen.chance.uniform(south, north)
    half = 0.5 * seen.size * seen.chance.uniform(0.2, 0.6)
    box = shapely.box(x - half, y - half, x + half, y + half)
    return seen.on(seen.plan | box if seen.chance.random() < 0.5 else seen.plan - box)


#: What may be wrong with the points, and with the footprint.
POINTS: dict[str, Callable[[_Seen], _Seen]] = {
    "plain": _plain, "disc": _disc, "strip": _strip, "half": _half, "noise": _noise, "outliers": _outliers,
    "tree": _tree, "rows": _rows, "thin": _thin,
}  # fmt: skip
FOOTPRINTS: dict[str, Callable[[_Seen], _Seen]] = {
    "shifted": _shifted, "resized": _resized, "turned": _turned, "extended": _extended,
}  # fmt: skip
#: The same, of which none was looked at when thresholds were chosen.
OTHER_POINTS = {"stripes": _stripes, "strips": _strips, "clumps": _clumps}
OTHER_FOOTPRINTS = {"box": _merged}
#: Roofs alone do not tell a traced roof that was not seen whole from a smaller one.
UNKNOWABLE = ("disc", "strip", "half", "stripes", "clumps")


def virtual_scene(name: str, seed: int) -> ModelScene:
    """Return one of `SHAPES`, with a density, a noise, an orientation and a size of its own."""
    chance = np.random.default_rng([seed, zlib.crc32(name.encode())])
    return model_scene(
        name,
        density=float(chance.choice(DENSITIES)),
        noise=float(chance.choice(NOISES)),
        rotation_deg=float(chance.uniform(0.0, 90.0)),
        seed=seed,
    )


def virtual_roof(name: str, seed: int) -> Roof:
    """Return the roof of a `virtual_scene`."""
    scene = virtual_scene(name, seed)
    return Roof(name, scene.points, truth_of(scene.building), GROUND)


def roofs(data: Path, seed: int, kinds: tuple[str, ...] = ("virtual", "drawn")) -> Iterator[Roof]:
    """Yield all virtual roofs and those that people drew."""
    if "virtual" in kinds:
        for name in SHAPES:
            yield virtual_roof(name, seed)
    if "drawn" in kinds:
        for drawn in drawn_roofs(data / FOLDER):
            truth, points = largest_part(drawn_truth(drawn), drawn.points)
            yield Roof(f"drawn {drawn.name}", points, truth, float(points[:, 2].min()) - 4.0)


def cases_of(roof: Roof, seed: int, others: bool = False) -> Iterator[Case]:
    """Yield a roof disturbed in known or in other ways: on its outline, on wrong ones, and traced."""
    plan = _largest(roof.truth.plan)
    points, footprints = (OTHER_POINTS, OTHER_FOOTPRINTS) if others else (POINTS, FOOTPRINTS)
    traced = {kind: disturb for kind, disturb in points.items() if kind not in UNKNOWABLE}
    for route, kinds in (("given", points), ("traced", traced), ("footprint", footprints)):
        for kind, disturb in kinds.items():
            chance = np.random.default_rng([seed, zlib.crc32(f"{roof.name} {route} {kind}".encode())])
            seen = disturb(_Seen(roof.points, plan, chance))
            n_inside = np.count_nonzero(shapely.contains_xy(seen.plan, *seen.points[:, :2].T))
            if n_inside >= MIN_POINTS:
                outline = None if route == "traced" else Outline.of(seen.plan)
                yield Case(roof.name, f"{route} {kind}", seen.points, roof.truth, roof.ground, outline)
