"""Façades in small virtual streets."""

import numpy as np
import pytest

from lidar_buildings.core.stages.facades.config import FacadesConfig
from lidar_buildings.core.stages.facades.facade import ARC, STRAIGHT
from lidar_buildings.core.stages.facades.finding import find_facades

#: Standard deviation of a scanner's ranges [m].
NOISE = 0.02


def wall(start, end, low=0.0, high=3.0, *, step=0.15, depth=0.0):
    """Return points of an upright rectangle, moved to its right by a depth [m]."""
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    along = (end - start) / np.hypot(*(end - start))
    u, z = np.meshgrid(np.arange(0.0, np.hypot(*(end - start)), step), np.arange(low, high, step))
    xy = start + u.reshape(-1, 1) * along + depth * np.array([along[1], -along[0]])
    return np.column_stack([xy, z.ravel()])


def ground(x, y, step=0.4):
    """Return level ground over a rectangle."""
    xy = np.meshgrid(np.arange(*x, step), np.arange(*y, step))
    return np.column_stack([xy[0].ravel(), xy[1].ravel(), np.zeros(xy[0].size)])


def facades_of(*parts, noise=NOISE, config=None, **columns):
    """Find the façades of points whose heights are their elevations, ground at 0."""
    points = np.concatenate(parts)
    is_ground = points[:, 2] == 0.0
    height = points[:, 2].copy()
    points = points + noise * np.random.default_rng(0).normal(size=points.shape)
    return find_facades(points, height, is_ground, config, **columns)


STREET = ground((-2.0, 14.0), (-6.0, 0.0))


def test_wall_is_found_where_it_stands_and_as_far_as_it_was_seen():
    (facade,) = facades_of(wall((1.0, 0.0), (9.0, 0.0), 0.3, 2.95), STREET)
    assert facade.kind == STRAIGHT
    assert abs(facade.foot[:, 1]).max() < 0.01  # a tenth of the noise, at the ends
    assert np.sort(facade.foot[:, 0]) == pytest.approx((1.0, 9.0), abs=0.2)  # a step of the points
    assert facade.foot[0, 0] > facade.foot[1, 0]  # the street, in the south, is on the left
    assert (facade.bottom, facade.top) == pytest.approx((0.3, 2.85), abs=0.1)
    assert facade.sigma == pytest.approx(NOISE, rel=0.3)
    assert facade.confidence == 1.0
    assert facade.seen_share == 1.0
    assert facade.coverage > 0.9
    assert facade.building_id == -1


def test_windows_and_what_is_behind_glass_do_not_pull_the_line():
    panes = [wall((x, 0.0), (x + 1.2, 0.0), 0.9, 2.4, depth=-0.15) for x in (2.0, 5.0, 8.0)]
    room = wall((2.0, 0.0), (9.0, 0.0), 0.9, 2.0, depth=-1.2, step=0.3)
    (facade,) = facades_of(wall((1.0, 0.0), (10.0, 0.0), 0.3, 3.3), *panes, room, STREET)
    assert abs(facade.foot[:, 1]).max() < 0.01


@pytest.mark.parametrize(("is_seen_over", "n"), [(False, 1), (True, 2)])
def test_wall_of_a_room_is_no_facade_unlike_what_is_seen_over_a_front(is_seen_over, n):
    low, high = (4.2, 6.0) if is_seen_over else (0.6, 2.4)
    behind = wall((3.0, 5.0), (7.0, 5.0), low, high, step=0.2)
    found = facades_of(wall((0.0, 0.0), (12.0, 0.0), 0.3, 3.0), behind, ground((-2.0, 14.0), (-20.0, 0.0)))
    assert len(found) == n


def test_two_passes_with_poses_apart_make_one_wall_between():
    passes = (wall((1.0, offset), (9.0, offset), 0.3, 3.0) for offset in (-0.02, 0.02))
    (facade,) = facades_of(*passes, STREET)
    assert abs(facade.foot[:, 1]).max() < 0.02


def test_fronts_of_a_row_a_hand_apart_stay_apart_though_poses_are_noisy():
    fronts = [wall((x, y), (x + 6.0, y), 0.2, 5.0) for x, y in ((0.0, 0.0), (6.0, 0.12), (12.0, -0.04))]
    found = facades_of(*fronts, ground((-2.0, 20.0), (-6.0, -0.2)), noise=0.035)
    assert sum(one.length > 3.0 for one in found) == 3
    for facade in found:
        x = facade.foot[:, 0].mean()
        assert facade.foot[:, 1] == pytest.approx((0.0, 0.12, -0.04)[int(x // 6.0)], abs=0.03)


def test_far_wall_is_as_rough_as_the_poses_are_turned():
    (facade,) = facades_of(wall((1.0, 0.0), (11.0, 0.0), 0.3, 5.0, step=0.3), STREET, noise=0.1)
    assert abs(facade.foot[:, 1]).max() < 0.06
    assert facade.length == pytest.approx(10.0, abs=0.6)
    assert facade.sigma == pytest.approx(0.1, rel=0.3)


def test_round_front_is_an_arc_of_short_chords():
    angle = np.arange(-1.0, 1.0, 0.02)
    z = np.arange(0.3, 3.0, 0.15)
    a, z = (each.ravel() for each in np.meshgrid(angle, z))
    front = np.column_stack([6.0 * np.sin(a), -6.0 * np.cos(a), z])
    around = ground((-8.0, 8.0), (-14.0, 0.0))
    outside = around[np.hypot(around[:, 0], around[:, 1]) > 6.2]
    (facade,) = facades_of(front, outside)
    assert facade.kind == ARC
    assert np.hypot(*facade.foot.T) == pytest.approx(6.0, abs=0.02)
    assert facade.length == pytest.approx(12.0, abs=0.4)


def test_two_walls_meet_in_the_corner_that_neither_shows():
    facades = facades_of(
        wall((0.0, 0.0), (7.8, 0.0)), wall((8.0, 0.2), (8.0, 6.0)), STREET, ground((8.2, 14.0), (0.0, 8.0))
    )
    assert len(facades) == 2
    ends = np.concatenate([one.foot[[0, -1]] for one in facades])
    near = ends[np.hypot(*(ends - (8.0, 0.0)).T) < 0.05]
    assert len(near) == 2
    assert np.array_equal(*near)


@pytest.mark.parametrize(
    "parts",
    [
        [wall((1.0, 0.0), (9.0, 0.0), 0.2, 1.4)],  # a fence
        [wall((1.0, 0.0), (9.0, 0.0), 0.2, 1.9), wall((1.0, 3.0), (9.0, 3.0), 2.0, 4.0, step=0.1)],
        [wall((1.0, -1.0), (9.0, -1.0), 0.4, 2.6), ground((-2.0, 14.0), (0.0, 4.0))],  # a tram
        [wall((1.0, 0.0), (1.3, 0.0), 0.2, 4.0)],  # a post
    ],
    ids=["fence", "garden wall with a house behind", "tram on open ground", "post"],
)
def test_what_is_low_or_hides_nothing_is_no_facade(parts):
    found = facades_of(*parts, STREET)
    assert not [one for one in found if abs(one.foot[:, 1]).max() < 1.5]


def test_hedge_is_no_facade():
    random = np.random.default_rng(1)
    hedge = random.uniform((1.0, -0.4, 0.2), (9.0, 0.4, 2.6), (8000, 3))
    assert facades_of(hedge, STREET) == ()


def test_order_of_points_does_not_matter_and_one_set_shows_the_same():
    points = np.concatenate([wall((1.0, 0.0), (9.0, 0.5)), STREET])
    order = np.random.default_rng(2).permutation(len(points))
    one, other = (
        find_facades(points[rows], points[rows, 2], points[rows, 2] == 0.0)
        for rows in (np.arange(len(points)), order)
    )
    assert [facade.foot.tolist() for facade in one] == [facade.foot.tolist() for facade in other]


def test_what_context_shows_is_returned_as_no_core():
    points = np.concatenate([wall((0.0, 0.0), (12.0, 0.0)), STREET])
    found = find_facades(points, points[:, 2], points[:, 2] == 0.0, is_core=points[:, 0] < 5.0)
    ends = {one.is_core: np.sort(one.foot[:, 0]) for one in found}
    assert len(found) == 2
    assert ends[True] == pytest.approx((0.0, 5.0), abs=0.3)
    assert ends[False] == pytest.approx((5.0, 12.0), abs=0.3)


def test_gap_that_is_bridged_is_not_seen():
    config = FacadesConfig(max_gap=2.0)
    (facade,) = facades_of(wall((0.0, 0.0), (4.0, 0.0)), wall((5.5, 0.0), (10.0, 0.0)), STREET, config=config)
    assert facade.length == pytest.approx(10.0, abs=0.3)
    assert facade.seen_share == pytest.approx(0.85, abs=0.04)


def test_nothing_comes_of_nothing():
    empty = np.zeros((0, 3))
    assert find_facades(empty, np.zeros(0), np.zeros(0, dtype=bool)) == ()
    assert find_facades(STREET, STREET[:, 2], np.ones(len(STREET), dtype=bool)) == ()
