"""What lines end at: walls of the outline and other lines."""

from __future__ import annotations

import math

from lidar_buildings.core.kernels import kernel

#: Places differ by less from where they are in whole numbers [m].
_ROUNDING = 1e-3


@kernel
def is_far(x, y, ax, ay, bx, by, reach):  # type: ignore[no-untyped-def]
    """Whether a place is surely farther than so much from the line between two others."""
    return (
        (ax > x + reach and bx > x + reach)
        or (ax < x - reach and bx < x - reach)
        or (ay > y + reach and by > y + reach)
        or (ay < y - reach and by < y - reach)
    )


@kernel
def stop(t, fx, fy, ux, uy, stops, reach, beyond, but):  # type: ignore[no-untyped-def]
    """
    Return where the line crosses the nearest wall or step edge, NaN if there is none near.

    Stops are taken for longer than they are by `beyond` at either end: a line through a corner has to hit one
    of its walls. Stop number `but` is left out.
    """
    best, place = reach, math.nan
    x, y, around = fx + t * ux, fy + t * uy, reach + beyond + _ROUNDING
    for m in range(len(stops)):
        if is_far(x, y, stops[m, 0, 0], stops[m, 0, 1], stops[m, 1, 0], stops[m, 1, 1], around):
            continue
        wx, wy = stops[m, 1, 0] - stops[m, 0, 0], stops[m, 1, 1] - stops[m, 0, 1]
        length = math.hypot(wx, wy)
        across = ux * wy - uy * wx
        if m == but or length == 0.0 or abs(across) < 0.1 * length:
            continue
        dx, dy = stops[m, 0, 0] - fx, stops[m, 0, 1] - fy
        at = (dx * wy - dy * wx) / across
        along = (dx * uy - dy * ux) / across * length
        if -beyond <= along <= length + beyond and abs(at - t) < best:
            best, place = abs(at - t), at
    return place
