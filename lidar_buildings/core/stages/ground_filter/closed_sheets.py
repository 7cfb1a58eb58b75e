"""Points below a smooth, closed sheet: what hardly any pulse can have reached."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.ground_filter.error_layers import (
    Layers,
    columns_in_row,
    high_end,
    low_end,
    rise,
)

# Chosen with `bench.ground.noise`.
#: Largest distance of a smooth surface's points from the plane through three by three columns, rms [m]:
#: crowns are rougher.
MAX_ROUGHNESS = 0.2
#: A plane through fewer points says nothing; and so many of each layer are enough.
MIN_POINTS, MAX_POINTS = 6, 12
#: Radius of the disc about a point that a sheet has to cover, in its spacings: twenty points; and share of
#: them from which on it does.
SHEET_DISC, MIN_COVER = 2.5, 0.5
#: Radius of the disc in which all that is above a point is counted, in spacings: gaps are as narrow.
DISC = 1.25
#: Layers of a sheet that are looked at, and how far their slopes may be spread, rms: smooth spots of crowns
#: lean to all sides.
MAX_LAYERS, MAX_SPREAD = 200, 0.3
#: At the edge of the data discs count as so many times what is seen of them, at most.
MAX_BEYOND = 2.0
#: Columns around that the density of points is taken from.
DENSITY_REACH = 6
#: How many times as many points the sheets above have as what lies as low as a layer.
MIN_DENSER = 4.0
#: Within how many columns densities are compared. And how far beside a layer, at least in columns and in
#: parts of its depth below the sheet, beams lean in under roofs and decks from open ground.
RADIUS, MIN_RADIUS, LEAN = 20, 8, 3.0
#: Share of the columns around, and least number, that show open points as low where that is the ground; open
#: are those with less than this share of what is above others.
MIN_OPEN_SHARE, MIN_OPEN, OPEN = 0.03, 4, 0.2
#: Layers of a floor that is seen through gaps, at least.
MIN_FLOOR = 6
#: Mean share above the points of a floor that is seen through gaps, at most, and so much less by chance for
#: one over the root of their number: above errors it is one.
MAX_SHARE, CHANCE = 0.9, 0.8

#: Layers a block of work.
BLOCK = 4096


def below_closed_sheets(layers: Layers, gap: float) -> NDArray[np.bool_]:
    """
    Return which layers lie below a smooth, closed and much denser sheet, and nothing open lies as low.

    What is more than the `gap` [m] above a point covers it.
    """
    n = len(layers.column)
    smooth, planes = np.zeros(n, dtype=np.bool_), np.zeros((n, 3))
    cover, share, sheet = np.zeros(n, dtype=np.bool_), np.zeros(n), np.zeros((n, 3))
    hidden = np.zeros(n, dtype=np.bool_)
    for_row_blocks(lambda *run: _find_smooth(layers, gap, smooth, planes, *run), n, BLOCK)
    for_row_blocks(
        lambda *run: _find_covers(layers, smooth, planes, gap, cover, share, sheet, *run), n, BLOCK
    )
    for_row_blocks(
        lambda *run: _find_hidden(layers, smooth, cover, share, sheet, gap, hidden, *run), n, BLOCK
    )
    return hidden


@kernel
def _find_smooth(layers, gap, smooth, planes, first, end):  # type: ignore[no-untyped-def]
    """Tell which layers lie on a plane with those around them: elevation at the origin, rise over run."""
    room = np.empty((9 * MAX_POINTS * 4, 3))
    for j in range(first, end):
        k = layers.column[j]
        m = 0
        for step in range(-1, 2):
            start, stop = columns_in_row(layers, k, step, 1)
            for other in range(start, stop):
                across = layers.numbers[other] - layers.numbers[k] - step * layers.width
                up = 0.5 * (rise(layers, k, across, step) - rise(layers, other, -across, -step))
                low, high = low_end(layers, j) + up - gap, high_end(layers, j) + up + gap
                for i in range(layers.first[other], layers.first[other + 1]):
                    if low_end(layers, i) > high:
                        break
                    if high_end(layers, i) < low:
                        continue
                    begin, stop_at = layers.begin[i], layers.begin[i + 1]
                    for p in range(begin, stop_at, max(1, (stop_at - begin) // MAX_POINTS)):
                        if m < len(room):
                            for axis in range(3):
                                room[m, axis] = layers.points[p, axis]
                            m += 1
        smooth[j] = m >= MIN_POINTS and _roughness(room[:m], planes[j]) <= MAX_ROUGHNESS


@kernel
def _roughness(points, plane):  # type: ignore[no-untyped-def]
    """Return the root mean square distance along z from the plane of least squares, and write that [m]."""
    n = len(points)
    x, y, z = points[:, 0].mean(), points[:, 1].mean(), points[:, 2].mean()
    xx, xy, yy, xz, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
        xz, yz, zz = xz + dx * dz, yz + dy * dz, zz + dz * dz
    det = xx * yy - xy * xy
    if det <= 1e-6 * xx * yy:
        return np.inf
    a, b = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
    plane[0], plane[1], plane[2] = z - a * x - b * y, a, b
    return math.sqrt(max(zz - a * xz - b * yz, 0.0) / (n - 3))


@kernel
def _find_covers(layers, smooth, planes, gap, cover, share, sheet, first, end):  # type: ignore[no-untyped-def]
    """Tell which layers a sheet covers, the share of what is above around that is above each, and sheets."""
    ups, weights = np.empty((MAX_LAYERS, 3)), np.empty(MAX_LAYERS, dtype=np.int64)
    for j in range(first, end):
        k = layers.column[j]
        if not _is_below_any(layers, j, gap):
            continue
        n_any, n_sheet, n_places = 0, 0, 0
        for step in range(-DENSITY_REACH, DENSITY_REACH + 1):
            start, stop = columns_in_row(layers, k, step, DENSITY_REACH)
            if start == stop:
                continue
            n_places += layers.numbers[stop - 1] - layers.numbers[start] + 1
            for other in range(start, stop):
                across = layers.numbers[other] - layers.numbers[k] - step * layers.width
                level = high_end(layers, j) + rise(layers, k, across, step) + gap
                for i in range(layers.first[other], layers.first[other + 1]):
                    if high_end(layers, i) > level:
                        n_points = layers.begin[i + 1] - layers.begin[i]
                        n_any, n_sheet = n_any + n_points, n_sheet + smooth[i] * n_points
        area = n_places * layers.size**2
        if n_any > 0:
            share[j] = _above(layers, j, DISC * math.sqrt(area / n_any), gap) / (math.pi * DISC * DISC)
        if n_sheet > 0 and SHEET_DISC * math.sqrt(area / n_sheet) <= DENSITY_REACH * layers.size:
            radius = SHEET_DISC * math.sqrt(area / n_sheet)
            found = _sheet_above(layers, j, radius, smooth, planes, gap, ups, weights, sheet[j])
            cover[j] = found >= MIN_COVER * math.pi * SHEET_DISC * SHEET_DISC


@kernel
def _above(layers, j, radius, gap):  # type: ignore[no-untyped-def]
    """Count the points in the disc about one of a layer that are above it, as if all of the disc had data."""
    k, point = layers.column[j], layers.points[(layers.begin[j] + layers.begin[j + 1] - 1) // 2]
    n, n_places, reach = 0, 0, math.ceil(radius / layers.size)
    for step in range(-reach, reach + 1):
        start, stop = columns_in_row(layers, k, step, reach)
        if start < stop:
            n_places += layers.numbers[stop - 1] - layers.numbers[start] + 1
        for p in range(layers.begin[layers.first[start]], layers.begin[layers.first[stop]]):
            dx, dy = layers.points[p, 0] - point[0], layers.points[p, 1] - point[1]
            up = dx * layers.gradient[k, 0] + dy * layers.gradient[k, 1]
            is_above = layers.points[p, 2] - point[2] - max(up, 0.0) > gap
            n += is_above and dx * dx + dy * dy <= radius * radius
    return n * min((2 * reach + 1) ** 2 / n_places, MAX_BEYOND)


@kernel
def _sheet_above(layers, j, radius, smooth, planes, gap, ups, weights, sheet):  # type: ignore[no-untyped-def]
    """Count the points of the same smooth sheet in the disc; write how far it is, and its rise over run."""
    k, point = layers.column[j], layers.points[(layers.begin[j] + layers.begin[j + 1] - 1) // 2]
    n, n_places, reach = 0, 0, math.ceil(radius / layers.size)
    for step in range(-reach, reach + 1):
        start, stop = columns_in_row(layers, k, step, reach)
        if start < stop:
            n_places += layers.numbers[stop - 1] - layers.numbers[start] + 1
        for i in range(layers.first[start], layers.first[stop]):
            up = planes[i, 0] + planes[i, 1] * point[0] + planes[i, 2] * point[1] - point[2]
            if not smooth[i] or up <= gap or n == len(ups):
                continue
            weight = 0
            for p in range(layers.begin[i], layers.begin[i + 1]):
                dx, dy = layers.points[p, 0] - point[0], layers.points[p, 1] - point[1]
                # Above where it is, too, and not only where it goes on to the point.
                weight += layers.points[p, 2] - point[2] > gap and dx * dx + dy * dy <= radius * radius
            if weight > 0:
                ups[n, 0], ups[n, 1], ups[n, 2], weights[n] = up, planes[i, 1], planes[i, 2], weight
                n += 1
    most, spread = 0, 0.0
    for one in range(n):
        total, east, north, square = 0, 0.0, 0.0, 0.0
        for other in range(n):
            if abs(ups[other, 0] - ups[one, 0]) <= gap:
                a, b, w = ups[other, 1], ups[other, 2], weights[other]
                total, east, north, square = (
                    total + w,
                    east + w * a,
                    north + w * b,
                    square + w * (a * a + b * b),
                )
        if total > most:
            most = total
            sheet[0], sheet[1], sheet[2] = ups[one, 0], east / total, north / total
            spread = square / total - sheet[1] ** 2 - sheet[2] ** 2
    if spread > MAX_SPREAD**2:
        return 0.0
    return most * min((2 * reach + 1) ** 2 / n_places, MAX_BEYOND)


@kernel
def _is_below_any(layers, j, gap):  # type: ignore[no-untyped-def]
    """Whether anything lies above a layer in its own column or those next to it."""
    k = layers.column[j]
    for step in range(-1, 2):
        start, stop = columns_in_row(layers, k, step, 1)
        for other in range(start, stop):
            across = layers.numbers[other] - layers.numbers[k] - step * layers.width
            top = layers.first[other + 1] - 1
            if high_end(layers, top) > high_end(layers, j) + rise(layers, k, across, step) + gap:
                return True
    return False


@kernel
def _find_hidden(layers, smooth, cover, share, sheet, gap, hidden, first, end):  # type: ignore[no-untyped-def]
    """Tell which of the layers below sheets nothing open around reaches down to."""
    for j in range(first, end):
        hidden[j] = cover[j] and not _is_reached(layers, j, smooth, share, sheet[j], gap)


@kernel
def _is_reached(layers, j, smooth, share, sheet, gap):  # type: ignore[no-untyped-def]
    """Whether enough around is open down to a layer, or it is as dense as what is above, or seen in gaps."""
    k = layers.column[j]
    near = min(max(LEAN * sheet[0] / layers.size, MIN_RADIUS), RADIUS)
    if _is_open_near(layers, j, share, sheet, gap, near):
        return True
    n_level, n_sheet, n_mates, covered = 0, 0, 0, 0.0
    for step in range(-RADIUS, RADIUS + 1):
        start, stop = columns_in_row(layers, k, step, RADIUS)
        for other in range(start, stop):
            across = layers.numbers[other] - layers.numbers[k] - step * layers.width
            away = across * across + step * step
            if away > RADIUS * RADIUS:
                continue
            up = layers.size * (across * sheet[1] + step * sheet[2])
            low, high = low_end(layers, j) + up - gap, high_end(layers, j) + up + gap
            for i in range(layers.first[other], layers.first[other + 1]):
                n_points = layers.begin[i + 1] - layers.begin[i]
                if low_end(layers, i) > high:
                    n_sheet += smooth[i] * n_points
                elif high_end(layers, i) >= low:
                    n_level += n_points
                    if away <= near * near:
                        n_mates, covered = n_mates + 1, covered + share[i]
    is_floor = n_mates >= MIN_FLOOR and covered < MAX_SHARE * n_mates - CHANCE * math.sqrt(n_mates)
    return is_floor or n_sheet < MIN_DENSER * n_level


@kernel
def _is_open_near(layers, j, share, sheet, gap, near):  # type: ignore[no-untyped-def]
    """Whether enough of the columns around show open points as low as a layer; most do soon."""
    k, reach = layers.column[j], int(near)
    n_open, n_columns, surely = 0, 0, max(MIN_OPEN, MIN_OPEN_SHARE * (2 * reach + 1) ** 2)
    for step in range(-reach, reach + 1):
        start, stop = columns_in_row(layers, k, step, reach)
        for other in range(start, stop):
            across = layers.numbers[other] - layers.numbers[k] - step * layers.width
            if across * across + step * step > near * near:
                continue
            high = high_end(layers, j) + layers.size * (across * sheet[1] + step * sheet[2]) + gap
            is_open = False
            for i in range(layers.first[other], layers.first[other + 1]):
                if low_end(layers, i) > high:
                    break
                is_open |= share[i] < OPEN
            n_columns, n_open = n_columns + 1, n_open + is_open
            if n_open >= surely:
                return True
    return n_open >= max(MIN_OPEN, MIN_OPEN_SHARE * n_columns)
