"""Plans of buildings with exact corners and arcs, at the origin, in their own directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from shapely.affinity import rotate, translate
from shapely.geometry import LineString, Point, Polygon, box

#: Greatest distance of a curved wall from the chords that stand for it in the truth [m].
CHORD_ERROR = 0.0005
#: A vertex that turns less is none: unions and buffers leave some on straight walls [m].
ON_A_LINE = 1e-6


class Arc(NamedTuple):
    """A wall that is part of a circle."""

    centre: tuple[float, float]  #: in plan [m]
    radius: float  #: of the circle [m]


@dataclass(frozen=True)
class Plan:
    """The outline of a building."""

    polygon: Polygon  #: exact where walls are straight, chords elsewhere
    #: ``"rectilinear"``: one pair of directions; ``"oblique"``: straight walls; ``"curved"``.
    kind: str = "rectilinear"
    arcs: tuple[Arc, ...] = ()  #: the walls that are arcs of circles


def rectangle(length: float, width: float) -> Plan:
    """A rectangle round the origin."""
    return Plan(box(-length / 2, -width / 2, length / 2, width / 2))


def _of(*corners: tuple[float, float], holes=(), kind="rectilinear") -> Plan:
    """A plan from its corners, moved so that its middle is the origin."""
    polygon = Polygon(corners, holes)
    x, y = polygon.envelope.centroid.coords[0]
    return Plan(shapely.transform(polygon, lambda xy: xy - (x, y)), kind)


def _united(*parts: Polygon, kind: str) -> Plan:
    """A plan from parts that overlap."""
    return Plan(shapely.union_all(parts).simplify(ON_A_LINE), kind)


def facade_step() -> Plan:
    """A façade that steps back by 0.6 m halfway."""
    return _of((0, 0), (15, 0), (15, 0.6), (30, 0.6), (30, 14), (0, 14))


def staircase() -> Plan:
    """Five real steps of 1.5 m, as a house has that follows a slanting street."""
    steps = [corner for k in range(5) for corner in ((24 - 4.0 * k, 1.5 * k), (24 - 4.0 * k, 1.5 * k + 1.5))]
    return _of((0, -9), (24, -9), *steps[1:], (0, 7.5))


def comb() -> Plan:
    """A row of houses with extensions 3 m deep and 4 m wide, 4 m apart."""
    teeth = [
        c
        for k in range(5)
        for c in ((4 + 8.0 * k, 0), (4 + 8.0 * k, -3), (8 + 8.0 * k, -3), (8 + 8.0 * k, 0))
    ]
    return _of((0, 0), *teeth, (44, 0), (44, 9), (0, 9))


def courtyard() -> Plan:
    return _of((0, 0), (32, 0), (32, 26), (0, 26), holes=[[(9, 8), (9, 18), (23, 18), (23, 8)]])


def two_courtyards() -> Plan:
    holes = [[(8, 8), (8, 18), (20, 18), (20, 8)], [(28, 8), (28, 18), (40, 18), (40, 8)]]
    return _of((0, 0), (48, 0), (48, 26), (0, 26), holes=holes)


def l_with_courtyard() -> Plan:
    """An L whose courtyard lies in its corner, off the middle."""
    hole = [(7, 6), (7, 15), (17, 15), (17, 6)]
    return _of((0, 0), (46, 0), (46, 12), (26, 12), (26, 34), (0, 34), holes=[hole])


def cut_corners() -> Plan:
    """Two corners cut off at 45°, 4 m deep."""
    return _of((4, 0), (24, 0), (24, 12), (20, 16), (0, 16), (0, 4), kind="oblique")


def chamfered() -> Plan:
    """All four corners cut off by 2 m."""
    corners = [(2, 0), (22, 0), (24, 2), (24, 14), (22, 16), (2, 16), (0, 14), (0, 2)]
    return _of(*corners, kind="oblique")


def regular(n_corners: int, radius: float) -> Plan:
    """A regular polygon."""
    angle = 2 * np.pi * np.arange(n_corners) / n_corners
    return Plan(Polygon(radius * np.column_stack((np.cos(angle), np.sin(angle)))), "oblique")


def bent_bar() -> Plan:
    """A bar 12 m wide that bends by 25° twice."""
    turn = np.deg2rad([0.0, 25.0, 50.0])
    steps = 28.0 * np.column_stack((np.cos(turn), np.sin(turn)))
    middle = np.vstack([(0.0, 0.0), steps.cumsum(axis=0)])
    bar = LineString(middle - middle.mean(axis=0)).buffer(6.0, cap_style="flat", join_style="mitre")
    return Plan(bar.simplify(ON_A_LINE), "oblique")


def three_wings() -> Plan:
    """A block of 36 × 14 m with a wing at 25° and one at 50°."""
    wings = [rotate(box(0, -5, 26, 5), angle, origin=(0, 0)) for angle in (25, 180 + 50)]
    placed = [translate(wing, x) for wing, x in zip(wings, (12, -12), strict=True)]
    return _united(box(-18, -7, 18, 7), *placed, kind="oblique")


def trapezoid() -> Plan:
    return _of((0, 0), (30, 0), (22, 14), (4, 14), kind="oblique")


def plot_filling() -> Plan:
    """A house on the wedge between two streets, no angle right."""
    return _of((0, 0), (26, 3), (30, 9), (11, 25), (5, 23), kind="oblique")


def round_tower(radius: float) -> Plan:
    return Plan(_disc((0.0, 0.0), radius), "curved", (Arc((0.0, 0.0), radius),))


def apse() -> Plan:
    """A nave with a semicircular apse."""
    polygon = shapely.union_all([box(-16, -7, 10, 7), _disc((10.0, 0.0), 7.0)])
    return Plan(polygon, "curved", (Arc((10.0, 0.0), 7.0),))


def curved_facade() -> Plan:
    """A sector of a ring, as a curved city hall: radii 40 and 26 m, 100°."""
    angle = np.deg2rad(np.linspace(-50, 50, 600))
    around = np.column_stack((np.cos(angle), np.sin(angle)))
    middle = (-33.0, 0.0)
    return Plan(
        Polygon(np.vstack([40 * around, 26 * around[::-1]]) + middle),
        "curved",
        (Arc(middle, 40.0), Arc(middle, 26.0)),
    )


def rounded_hall() -> Plan:
    """An ellipse of 44 × 28 m: round, but no circle."""
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    return Plan(Polygon(np.column_stack((22 * np.cos(angle), 14 * np.sin(angle)))), "curved")


def _disc(centre: tuple[float, float], radius: float) -> Polygon:
    """A circle of chords that are exact to `CHORD_ERROR`."""
    quarter = int(np.ceil(np.pi / 4 / np.arccos(1 - CHORD_ERROR / radius)))
    return Point(centre).buffer(radius, quad_segs=quarter)


#: Name → function, every plan there is.
PLANS: dict[str, Callable[[], Plan]] = {
    "rectangle_8_6": lambda: rectangle(8, 6),
    "rectangle_14_10": lambda: rectangle(14, 10),
    "rectangle_30_18": lambda: rectangle(30, 18),
    "rectangle_60_30": lambda: rectangle(60, 30),
    "long_hall": lambda: Plan(rotate(rectangle(120, 20).polygon, 1.0)),
    "l_shape": lambda: _of((0, 0), (24, 0), (24, 10), (10, 10), (10, 20), (0, 20)),
    "small_l": lambda: _of((0, 0), (11, 0), (11, 5), (6, 5), (6, 9), (0, 9)),
    "t_shape": lambda: _of((0, 0), (28, 0), (28, 9), (18, 9), (18, 22), (9, 22), (9, 9), (0, 9)),
    "u_shape": lambda: _of((0, 0), (30, 0), (30, 22), (21, 22), (21, 9), (9, 9), (9, 22), (0, 22)),
    "z_shape": lambda: _of((0, 0), (22, 0), (22, 10), (34, 10), (34, 20), (13, 20), (13, 9), (0, 9)),
    "cross": lambda: _united(box(-15, -5, 15, 5), box(-5, -15, 5, 15), kind="rectilinear"),
    "facade_step": facade_step,
    "staircase": staircase,
    "comb": comb,
    "courtyard": courtyard,
    "two_courtyards": two_courtyards,
    "l_with_courtyard": l_with_courtyard,
    "cut_corners": cut_corners,
    "chamfered": chamfered,
    "octagon": lambda: regular(8, 12.0),
    "hexagon": lambda: regular(6, 10.0),
    "bent_bar": bent_bar,
    "three_wings": three_wings,
    "trapezoid": trapezoid,
    "plot_filling": plot_filling,
    "round_tower_4": lambda: round_tower(4.0),
    "round_tower_8": lambda: round_tower(8.0),
    "round_tower_20": lambda: round_tower(20.0),
    "apse": apse,
    "curved_facade": curved_facade,
    "rounded_hall": rounded_hall,
}
