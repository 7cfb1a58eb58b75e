"""Low gross errors: small groups of points below everything that surrounds them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.ground_filter.gross_errors.noise_layers import (
    Layers,
    columns_in_row,
    high_end,
    low_end,
    rise,
)
from lidar_buildings.core.stages.ground_filter.gross_errors.open_pit import is_open_pit

# Chosen with `bench.ground.noise` and the scenes of the tests.
#: Columns between which layers still touch: ground seen through gaps is connected over so many.
REACH = 3
#: Columns around that support the level of a group: fewer may be gross errors themselves ...
MIN_SUPPORT = 6
#: ... and most of these from one other small group.
MAX_OF_SMALL = 2
#: By what share the radius shrinks per unit of slope: the steeper, the less far terrain is plane.
SHRINKAGE = 1.0
#: A group has to be below the larger part of what is around: this many columns for each of its own.
MIN_SURROUNDINGS = 2
#: Gross errors below gross errors are found one after the other; wide margin.
MAX_PASSES = 10
#: What is known of a layer.
UNKNOWN, LARGE, ERROR = 0, 1, 2


def find_low_layers(layers: Layers, gap: float, radius: int, limit: int) -> NDArray[np.bool_]:
    """
    Return which layers are low gross errors.

    A group is what is connected: layers of columns at most three apart whose elevations, the terrain's
    slope allowed for, are within `gap`. It is an error if it is small, if within the radius hardly
    anything else reaches down to its level, the slope again allowed for, and if it is no open pit.

    Layers are split at `gap` [m]; the `radius` is in columns, and `limit` is the most layers of a group.
    """
    bottom, seeds = layers.first[:-1].copy(), layers.first[:-1]
    n_layers = len(layers.column)
    state, group_of = np.zeros(n_layers, dtype=np.uint8), np.full(n_layers, -1, dtype=np.int64)
    for _ in range(MAX_PASSES):
        errors, open_cases = _judge_groups(layers, bottom, seeds, gap, radius, limit, state, group_of)
        if len(errors) == 0:
            break
        state[errors] = ERROR
        seeds = np.append(open_cases, _new_bottoms(layers, bottom, state, np.unique(layers.column[errors])))
        group_of[:] = -1
    return state == ERROR


def _new_bottoms(
    layers: Layers, bottom: NDArray[np.int64], state: NDArray[np.uint8], columns: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Raise the bottom of some columns above the errors; −1 where none is left. Return the new ones."""
    for k in columns:
        left = np.flatnonzero(state[layers.first[k] : layers.first[k + 1]] != ERROR)
        bottom[k] = layers.first[k] + left[0] if len(left) > 0 else -1
    raised = bottom[columns]
    return raised[raised >= 0]


@kernel
def _judge_groups(layers, bottom, seeds, gap, radius, limit, state, group_of):  # type: ignore[no-untyped-def]
    """Return the layers of groups that are errors, and the seeds of those that others may still hide."""
    members, begins = _gather_groups(layers, seeds, gap, limit, state, group_of)
    errors, open_cases = np.empty(len(members), np.int64), np.empty(len(begins), np.int64)
    n_errors, n_open = 0, 0
    # How many columns of a small group support the one under judgement, which is noted beside.
    counted, judged = np.zeros(len(state), dtype=np.int64), np.full(len(state), -1, dtype=np.int64)
    for i in range(len(begins) - 1):
        group = members[begins[i] : begins[i + 1]]
        if _is_supported(layers, bottom, group, gap, radius, state, group_of, counted, judged):
            open_cases[n_open] = group[0]
            n_open += 1
        elif not is_open_pit(layers, group, gap):
            for layer in group:
                errors[n_errors] = layer
                n_errors += 1
    return errors[:n_errors], open_cases[:n_open]


@kernel
def _gather_groups(layers, seeds, gap, limit, state, group_of):  # type: ignore[no-untyped-def]
    """Return the layers of all small groups that a seed belongs to, and where each begins, and the end."""
    members, begins = np.empty(len(group_of), np.int64), np.zeros(len(seeds) + 1, np.int64)
    n_members, n_groups = 0, 0
    group = np.empty(limit, dtype=np.int64)
    for seed in seeds:
        if state[seed] == UNKNOWN and group_of[seed] < 0:
            n_more = _gather_group(layers, seed, gap, state, group_of, group)
            for k in range(n_more):
                members[n_members + k] = group[k]
            if n_more > 0:
                n_members, n_groups = n_members + n_more, n_groups + 1
                begins[n_groups] = n_members
    return members[:n_members], begins[: n_groups + 1]


@kernel
def _gather_group(layers, seed, gap, state, group_of, members):  # type: ignore[no-untyped-def]
    """
    Fill `members` with what is connected with a layer; return how many, or −1 if they do not fit.

    `group_of` becomes the seed for each; all of a group that does not fit are marked as LARGE.
    """
    n_members, done = 1, 0
    members[0], group_of[seed] = seed, seed
    while done < n_members:
        layer = members[done]
        done += 1
        k = layers.column[layer]
        for step in range(-REACH, REACH + 1):
            start, stop = columns_in_row(layers, k, step, REACH)
            for other in range(start, stop):
                across = layers.numbers[other] - layers.numbers[k] - step * layers.width
                up = 0.5 * (rise(layers, k, across, step) - rise(layers, other, -across, -step))
                low, high = low_end(layers, layer) + up - gap, high_end(layers, layer) + up + gap
                for j in range(layers.first[other], layers.first[other + 1]):
                    if low_end(layers, j) > high:
                        break
                    if high_end(layers, j) < low or group_of[j] == seed or state[j] == ERROR:
                        continue
                    if state[j] == LARGE or n_members == len(members):
                        for i in range(n_members):
                            state[members[i]] = LARGE
                        return -1
                    members[n_members], group_of[j] = j, seed
                    n_members += 1
    return n_members


@kernel
def _is_supported(  # type: ignore[no-untyped-def]
    layers, bottom, group, gap, radius, state, group_of, counted, judged
):
    """
    Whether enough columns around reach down to a group's level, or too few are there to tell.

    Another small group, which may be an error as well, counts for no more than two of its columns.
    """
    seed, k = group[0], layers.column[group[0]]
    top = -np.inf
    for layer in group:
        number = layers.numbers[layers.column[layer]]
        east = number % layers.width - layers.numbers[k] % layers.width
        north = number // layers.width - layers.numbers[k] // layers.width
        top = max(top, high_end(layers, layer) - rise(layers, k, east, north))
    slope = math.hypot(layers.gradient[k, 0], layers.gradient[k, 1])
    radius = math.ceil(radius / (1.0 + SHRINKAGE * slope))
    n_level, n_above = 0, 0
    for step in range(-radius, radius + 1):
        start, stop = columns_in_row(layers, k, step, radius)
        for other in range(start, stop):
            b = bottom[other]
            across = layers.numbers[other] - layers.numbers[k] - step * layers.width
            if b < 0 or group_of[b] == seed or across * across + step * step > radius * radius:
                continue
            if low_end(layers, b) - rise(layers, k, across, step) > top + gap:
                n_above += 1
            elif state[b] == LARGE or group_of[b] < 0:
                n_level += 1
            else:
                n_level += _count_small(group_of[b], seed, counted, judged)
            if n_level >= MIN_SUPPORT:
                return True
    return n_above < max(MIN_SUPPORT, MIN_SURROUNDINGS * len(group))


@kernel
def _count_small(small, seed, counted, judged):  # type: ignore[no-untyped-def]
    """Count a column of a small group for the group of a seed: 1 until there are enough of it, then 0."""
    if judged[small] != seed:
        judged[small], counted[small] = seed, 0
    counted[small] += 1
    return 1 if counted[small] <= MAX_OF_SMALL else 0
