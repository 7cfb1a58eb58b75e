"""
Single buildings with exact outlines and the lidar points of their roofs, in every orientation.

Each scene takes `density` [pts/m²], `noise` (σ along each axis) [m], `rotation_deg` and `seed`. The seed
draws the direction of flight, which has nothing to do with the building's, how much further apart scan lines
are than the points along them, how regular the pattern is, and where it and the building lie.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from bench.scenes.outline_shapes import PLANS, Arc, Plan

__all__ = ["PLANS", "ROTATIONS", "Arc", "OutlineScene", "Scan", "outline_scene", "outline_scenes"]

#: Twelve orientations that are all different modulo 90° [deg].
ROTATIONS = tuple(37.5 * k % 360 for k in range(12))
#: Elevation of all roofs [m].
ROOF = 8.0
#: Buildings stand within so many metres of the map's origin, so that grids cut them anywhere.
REACH = 300.0
#: Ratios of the spacing across scan lines to that along them.
ANISOTROPY = (0.7, 1.7)
#: Largest deviation from a regular pattern along either axis; at ½ a point is anywhere in its cell [cells].
JITTER = (0.1, 0.5)


@dataclass(frozen=True)
class Scan:
    """A pattern of points."""

    direction_deg: float  #: of the scan lines [deg]
    anisotropy: float  #: spacing across scan lines over the spacing along them
    jitter: float  #: largest deviation from a regular pattern [cells]
    drop_outs: float = 0.0  #: share of points that did not return

    @classmethod
    def drawn(
        cls, random: np.random.Generator, drop_outs: float = 0.0, anisotropy: float | None = None
    ) -> Scan:
        """Draw a pattern, of an anisotropy that may be given."""
        low, high = np.log(ANISOTROPY)
        ratio = float(np.exp(random.uniform(low, high)))
        ratio = ratio if anisotropy is None else anisotropy
        return cls(float(random.uniform(0, 180)), ratio, float(random.uniform(*JITTER)), drop_outs)

    def over(self, plan: Polygon, density: float, random: np.random.Generator) -> NDArray[np.float64]:
        """Return the positions inside a plan, line by line; each line starts anywhere."""
        along = np.sqrt(1 / (density * self.anisotropy))
        step = np.array([along, along * self.anisotropy])
        turn = np.deg2rad(self.direction_deg)
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        corners = shapely.get_coordinates(plan) @ axes.T
        low = corners.min(axis=0) - (1 + random.random(2)) * step
        columns, lines = np.ceil((corners.max(axis=0) - low) / step).astype(int) + 1
        cell = np.stack(np.meshgrid(np.arange(columns), np.arange(lines)), axis=-1).astype(np.float64)
        cell[..., 0] += random.random((lines, 1))
        cell += random.uniform(-self.jitter, self.jitter, cell.shape)
        xy = (low + cell.reshape(-1, 2) * step) @ axes
        shapely.prepare(plan)
        hit = shapely.intersects_xy(plan, xy[:, 0], xy[:, 1]) & (random.random(len(xy)) >= self.drop_outs)
        return xy[hit]


@dataclass(frozen=True, eq=False)
class OutlineScene:
    """A roof's points and its true outline."""

    name: str  #: of its plan, see `PLANS`
    kind: str  #: ``"rectilinear"``, ``"oblique"`` or ``"curved"``
    rotation_deg: float  #: of the plan [deg]
    points: NDArray[np.float64]  #: on the roof, in scan order, strip after strip [m], shape (n_points, 3)
    truth: Polygon  #: the outline, with its courtyards
    n_corners: int | None  #: corners of all rings; None where walls are curved
    arcs: tuple[Arc, ...]  #: centres and radii of the walls that are arcs of circles
    spacing: float  #: 1/√density [m]


def outline_scene(
    name: str,
    *,
    density: float = 8.0,
    noise: float = 0.03,
    rotation_deg: float = 0.0,
    seed: int = 0,
    scans: Sequence[Scan] | None = None,
    n_strips: int = 1,
    drop_outs: float = 0.0,
    anisotropy: float | None = None,
) -> OutlineScene:
    """
    Scan one building, one of `PLANS`, turned by an angle [deg].

    `density` is that of all strips together, before drop-outs [pts/m²]; `noise` is σ along each axis, after
    it was decided what is on the roof [m]. `scans` are one per strip; if not given, `n_strips` are drawn,
    with a share of drop-outs, and with an anisotropy that is drawn, too, if not given.
    """
    random = np.random.default_rng([seed, sorted(PLANS).index(name), round(10 * rotation_deg) % 3600])
    plan = _placed(PLANS[name](), rotation_deg, random.uniform(-REACH, REACH, 2))
    patterns = (
        [Scan.drawn(random, drop_outs, anisotropy) for _ in range(n_strips)] if scans is None else list(scans)
    )
    xy = np.concatenate([scan.over(plan.polygon, density / len(patterns), random) for scan in patterns])
    points = np.column_stack([xy, np.full(len(xy), ROOF)]) + random.normal(0, noise, (len(xy), 3))
    return OutlineScene(
        name=name,
        kind=plan.kind,
        rotation_deg=rotation_deg,
        points=points,
        truth=plan.polygon,
        n_corners=None if plan.kind == "curved" else n_vertices(plan.polygon),
        arcs=plan.arcs,
        spacing=density**-0.5,
    )


def outline_scenes(
    density: float = 8.0,
    noise: float = 0.03,
    seed: int = 0,
    *,
    names: Collection[str] | None = None,
    rotations: Collection[float] = ROTATIONS,
    n_strips: int = 1,
    drop_outs: float = 0.0,
    anisotropy: float | None = None,
) -> list[OutlineScene]:
    """Scan every plan, or those named, in all orientations."""
    return [
        outline_scene(
            name,
            density=density,
            noise=noise,
            rotation_deg=rotation,
            seed=seed,
            n_strips=n_strips,
            drop_outs=drop_outs,
            anisotropy=anisotropy,
        )
        for name in names or PLANS
        for rotation in rotations
    ]


def n_vertices(polygon: Polygon) -> int:
    """Count the vertices of all rings, without those that close them."""
    return int(shapely.get_num_coordinates(polygon)) - len(shapely.get_rings(polygon))


def _placed(plan: Plan, rotation_deg: float, place: NDArray[np.float64]) -> Plan:
    """Turn a plan about its origin and move it."""
    turn = np.deg2rad(rotation_deg)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    arcs = tuple(Arc(tuple(np.array(arc.centre) @ axes + place), arc.radius) for arc in plan.arcs)
    polygon = shapely.transform(plan.polygon, lambda xy: xy @ axes + place)
    return Plan(shapely.orient_polygons(polygon), plan.kind, arcs)
