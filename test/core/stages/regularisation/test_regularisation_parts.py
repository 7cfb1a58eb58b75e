import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.stages.regularisation import directions
from lidar_buildings.core.stages.regularisation.config import AS_PUBLISHED
from lidar_buildings.core.stages.regularisation.drawing import offset_outwards, through_all_points
from lidar_buildings.core.stages.regularisation.regularising import regularise_outline
from lidar_buildings.core.stages.regularisation.samples import (
    SAMPLE_LENGTH,
    ConcavityLimits,
    RingSamples,
    bearing_points,
    sample_ring,
)
from lidar_buildings.core.stages.regularisation.walls import (
    ANGLE,
    CENTRE_X,
    CENTRE_Y,
    N_SHAPE,
    OFFSET,
    RADIUS,
    Fit,
    assemble,
    find_joint,
    fit_wall,
    nearest_meeting,
)
from lidar_buildings.core.surfaces.ring_division import (
    ARC,
    FREE,
    Costs,
    Division,
    algebraic_circle,
    divide_ring,
    running_sums,
)

LIMITS = ConcavityLimits(1.0, 12.0, 3.0, 3.0)


def line(angle, offset):
    shape = np.zeros(N_SHAPE)
    shape[[ANGLE, OFFSET]] = angle, offset
    return shape


def circle(x, y, radius):
    shape = np.zeros(N_SHAPE)
    shape[[CENTRE_X, CENTRE_Y, RADIUS]] = x, y, radius
    return shape


def jagged_box(seed, width=30.0, height=20.0):
    """The ring of a rectangle whose points lie up to a spacing inside."""
    rng = np.random.default_rng(seed)
    sides = []
    for start, along, inwards, length in (
        ((0, 0), (1, 0), (0, 1), width),
        ((width, 0), (0, 1), (-1, 0), height),
        ((width, height), (-1, 0), (0, -1), width),
        ((0, height), (0, -1), (1, 0), height),
    ):
        t = np.arange(1.5, length - 1.0, 1.2)[:, None]
        sides.append(np.array(start) + t * along + rng.uniform(0, 0.9, t.shape) * inwards)
    return np.vstack(sides)


def fitted(points, kind, angles=(), weight=1e4):
    weights, bears = np.ones(len(points)), np.ones(len(points), dtype=bool)
    sums = running_sums(points, weights)
    shape = np.empty(N_SHAPE)
    fit_wall(points, bears, sums, 0, len(points), kind, np.array(angles), weight, shape)
    return shape


@settings(max_examples=40)
@given(st.integers(0, 10_000))
def test_bridging_keeps_all_points_inside_a_simple_ring(seed):
    ring = jagged_box(seed)
    bears = bearing_points(ring, LIMITS)
    bridged = shapely.Polygon(ring[bears])
    assert bridged.is_valid
    assert shapely.dwithin(bridged, shapely.points(ring), 1e-9).all()
    assert 4 <= bears.sum() < len(ring)


def test_bridging_does_not_depend_on_where_the_ring_starts():
    ring = jagged_box(3)
    bears = bearing_points(ring, LIMITS)
    for shift in (1, 17, 40):
        assert np.array_equal(bearing_points(np.roll(ring, shift, axis=0), LIMITS), np.roll(bears, shift))


def test_a_notch_that_points_cannot_leave_empty_by_chance_stays_open():
    notched = shapely.box(0, 0, 30, 20).difference(shapely.box(10, 0, 16, 4))
    ring = shapely.get_coordinates(shapely.segmentize(shapely.orient_polygons(notched), 1.0).exterior)[:-1]
    bears = bearing_points(ring, LIMITS)
    assert shapely.Polygon(ring[bears]).area == pytest.approx(notched.area, abs=1.5)
    # A notch as shallow as points are apart is what scan lines leave by chance.
    shallow = shapely.box(0, 0, 30, 20).difference(shapely.box(10, 0, 16, 0.9))
    ring = shapely.get_coordinates(shapely.segmentize(shapely.orient_polygons(shallow), 1.0).exterior)[:-1]
    assert shapely.Polygon(ring[bearing_points(ring, LIMITS)]).area == pytest.approx(600.0, abs=2.0)


def test_samples_weigh_every_metre_alike():
    ring = jagged_box(1)
    samples = sample_ring(ring, 1.0, LIMITS)
    assert samples.weights.sum() * SAMPLE_LENGTH == pytest.approx(samples.length)
    assert np.array_equal(samples.points[samples.bears], ring[samples.rows[samples.bears]])
    # The lines of the box lie at most a spacing from its points.
    assert samples.is_on_wall.mean() > 0.9
    assert samples.is_on_wall[samples.rows].all()
    alone = sample_ring(ring, 1.0, None)
    assert np.array_equal(alone.points, ring)
    assert alone.bears.all()


def test_the_circle_from_running_sums_is_that_of_the_points():
    rng = np.random.default_rng(0)
    turn = np.linspace(0.3, 2.2, 40)
    points = np.column_stack([40 + 7 * np.cos(turn), -20 + 7 * np.sin(turn)])
    sums = running_sums(points, rng.uniform(0.5, 2.0, 40))
    x, y, radius, offsets = algebraic_circle(sums, 0, 40)
    assert (x, y, radius) == pytest.approx((40, -20, 7), abs=1e-6)
    assert offsets == pytest.approx(0.0, abs=1e-6)
    straight = np.column_stack([turn, 2 * turn])
    assert algebraic_circle(running_sums(straight, np.ones(40)), 0, 40)[2] == np.inf


def test_an_arc_is_fitted_by_the_least_distances():
    rng = np.random.default_rng(1)
    turn = np.linspace(0.0, 1.5, 60)
    radius = 9.0 + rng.normal(0, 0.05, 60)
    points = np.column_stack([3 + radius * np.cos(turn), 4 + radius * np.sin(turn)])
    shape = fitted(points, ARC)
    assert shape[[CENTRE_X, CENTRE_Y]] == pytest.approx((3.0, 4.0), abs=0.15)
    assert shape[RADIUS] == pytest.approx(9.0, abs=0.15)
    least = np.sum((np.hypot(*(points - shape[[CENTRE_X, CENTRE_Y]]).T) - shape[RADIUS]) ** 2)
    for change in np.eye(3) * 0.01:
        x, y, r = shape[[CENTRE_X, CENTRE_Y, RADIUS]] + change
        assert np.sum((np.hypot(*(points - (x, y)).T) - r) ** 2) >= least
    assert fitted(points[::-1].copy(), ARC)[RADIUS] == pytest.approx(-shape[RADIUS])


def test_the_adjusted_line_lies_between_the_points_and_the_given_direction():
    along = np.linspace(-5, 5, 50)
    points = np.column_stack([along, 0.1 * along + 3.0])
    own = fitted(points, FREE)
    assert np.allclose(points @ (np.cos(own[ANGLE]), np.sin(own[ANGLE])), own[OFFSET])
    along = float(((points - points.mean(axis=0)) ** 2).sum())
    for weight, share in ((0.0, 1.0), (along, 0.5), (1e9, 0.0)):
        shape = fitted(points, 0, [np.pi / 2], weight)
        # Half of the way is exact for small angles only.
        assert shape[ANGLE] - np.pi / 2 == pytest.approx(0.1 * share, abs=1e-3)


def test_walls_found_by_bearing_points_move_to_the_middle_of_all():
    ring = jagged_box(5)
    samples = sample_ring(ring - (15.0, 10.0), 1.0, LIMITS)
    fit = Fit(np.array([0.0, np.pi / 2]), 1e6, 1.0, 1.0, 0.1, 0.0)
    bearing = assemble(samples, divide_ring(samples.points, fit.angles, Costs(0.3, 10, 15, 10)), fit)
    assert len(bearing.first) == 4
    walled = through_all_points(samples, bearing, fit)
    # Points lie up to 0.9 inside the box, evenly: in the middle 0.45.
    corners = np.abs(walled.joints[:, 0])
    assert np.allclose(corners, (15.0 - 0.45, 10.0 - 0.45), atol=0.15)
    back = offset_outwards(samples, bearing, fit, 0.5)
    assert np.allclose(np.abs(back.joints[:, 0]), np.abs(bearing.joints[:, 0]) + 0.5, atol=1e-2)


@pytest.mark.parametrize("begin", range(4))
def test_an_arc_all_round_goes_through_most_points_wherever_it_begins(begin):
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    radius = np.where(np.arange(24) % 6 == 0, 6.0, 5.0)[:, None]
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    ring, every = np.roll(ring, 1, axis=0), np.ones(24, dtype=bool)
    between = np.column_stack([ring, 0.5 * (ring + np.roll(ring, -1, axis=0))]).reshape(-1, 2)
    samples = RingSamples(
        between, np.ones(48), np.tile([True, False], 24), np.repeat(np.arange(24), 2), ring, every
    )
    fit = Fit(np.array([0.0, np.pi / 2]), 1e6, 1.0, 1.0, 0.1, 0.0)
    division = Division(np.array([begin]), np.array([begin + 48]), np.array([ARC]), 0.0)
    walled = through_all_points(samples, assemble(samples, division, fit), fit)
    assert walled.shape[0, RADIUS] == pytest.approx(5.0, abs=0.01)


def test_walls_meet_where_both_equations_hold():
    x, y, meet = nearest_meeting(line(0.3, 2.0), line(1.9, -1.0), 0.0, 0.0)
    assert meet
    assert x * np.cos(0.3) + y * np.sin(0.3) == pytest.approx(2.0)
    assert x * np.cos(1.9) + y * np.sin(1.9) == pytest.approx(-1.0)
    assert not nearest_meeting(line(0.3, 2.0), line(0.3, 5.0), 0.0, 0.0)[2]
    for near in (4.0, -4.0):
        x, y, meet = nearest_meeting(line(np.pi / 2, 3.0), circle(0, 0, 5), near, 3.0)
        assert meet
        assert (x, y) == pytest.approx((near, 3.0))
        x, y, meet = nearest_meeting(circle(0, 0, 5), circle(0, 6, -5), near, 3.0)
        assert meet
        assert (x, y) == pytest.approx((near, 3.0))
    assert not nearest_meeting(line(np.pi / 2, 6.0), circle(0, 0, 5), 0.0, 6.0)[2]


@pytest.mark.parametrize(("turn_deg", "is_corner"), [(90.0, True), (120.0, True), (160.0, False)])
def test_a_sharp_corner_does_not_stick_out_beyond_its_points(turn_deg, is_corner):
    turn = np.deg2rad(90.0 - turn_deg)
    up = np.column_stack([np.zeros(11), np.arange(11.0)])
    away = np.array([0.9, 9.6]) + np.arange(11.0)[:, None] * (np.cos(turn), np.sin(turn))
    points = np.vstack([up, away, [[20.0, -20.0]]])
    shapes = np.array([fitted(up, FREE), fitted(away, FREE)])
    first, last = np.array([0, 11]), np.array([11, 22])
    joint = np.empty((2, 2))
    find_joint(points, first, last, shapes, 0, 1, 1.0, 1.0, joint)
    assert np.array_equal(*joint) == is_corner
    # A sharp corner would be 2.3 from the turn; its blunt end is beside the points.
    assert np.hypot(*(joint - (0.45, 9.8)).T).max() < 1.5


def test_shared_directions_are_those_of_a_joint_adjustment():
    rng = np.random.default_rng(0)
    angle = np.deg2rad(20.0)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    t = np.linspace(0, 20, 60)[:, None]
    walls = []
    for wall in (t * along, t * along + 9 * across, t * across, t * across + 20 * along):
        centred = wall + rng.normal(0, 0.1, wall.shape)
        centred -= centred.mean(axis=0)
        (xx, xy), (_, yy) = centred.T @ centred
        walls.append(directions.WallScatter(xx, xy, yy, 20.0))
    (found,) = directions.shared_directions(walls, np.deg2rad(10), 0.1, 15.0, 3)
    assert np.rad2deg(found) == pytest.approx(20.0, abs=0.2)


def test_a_ring_is_divided_at_its_turns():
    box = shapely.segmentize(shapely.box(0, 0, 12, 6), 1.0)
    ring = shapely.get_coordinates(shapely.orient_polygons(box).exterior)[:-1]
    samples, found = directions.divide_at_turns(sample_ring(ring - (6, 3), 1.0, None), np.deg2rad(40))
    assert len(samples.points) == len(ring) + 4
    assert sorted((found.last - found.first).tolist()) == [7, 7, 13, 13], "both ends are of a segment"
    assert set(found.kind.tolist()) == {FREE}
    kinds = directions.along_nearest(samples, found, np.array([0.0, np.pi / 2])).kind
    assert sorted(kinds.tolist()) == [0, 0, 1, 1]
    walls = directions.wall_scatters(samples.points, running_sums(samples.points, samples.weights), found, 2)
    assert sorted(wall.length for wall in walls) == pytest.approx([6.0, 6.0, 12.0, 12.0])


@pytest.mark.parametrize("turn", np.linspace(0.0, 1.5, 7))
def test_walls_of_a_single_edge_keep_the_direction(turn):
    corners = [(0, 0), (20, 0), (20, 14), (12, 14), (12, 12), (0, 12)]
    ring = shapely.get_coordinates(shapely.segmentize(shapely.Polygon(corners), 1.0).exterior)[:-1]
    ring = ring[(ring != (12, 13)).any(axis=1)]
    c, s = np.cos(turn), np.sin(turn)
    place = np.array([85_000.0, 447_500.0])
    found = regularise_outline(Outline(ring @ np.array([[c, s], [-s, c]]) + place), AS_PUBLISHED)
    edges = np.roll(found.outline.exterior, -1, axis=0) - found.outline.exterior
    angle = (np.arctan2(edges[:, 1], edges[:, 0]) - turn) % (np.pi / 2)
    assert len(edges) == len(corners)
    assert np.minimum(angle, np.pi / 2 - angle).max() < 1e-6


def test_an_arc_is_found_where_it_is_worth_its_cost():
    turn = np.linspace(0, np.pi, 40)
    bow = np.column_stack([8 * np.cos(turn), 10 + 8 * np.sin(turn)])
    sides = [np.column_stack([np.full(20, x), y]) for x, y in ((-8, np.linspace(9.5, 0, 20)),)]
    base = np.column_stack([np.linspace(-7.5, 7.5, 30), np.zeros(30)])
    right = np.column_stack([np.full(20, 8.0), np.linspace(0, 9.5, 20)])
    ring = np.vstack([bow, *sides, base, right]) + np.random.default_rng(0).normal(0, 0.05, (110, 2))
    angles = np.array([0.0, np.pi / 2])
    costs = Costs(0.1, 10.0, 15.0, 10.0, 25.0)
    found = divide_ring(ring, angles, costs)
    assert sorted(found.kind.tolist()) == [ARC, 0, 0, 1]
    assert ARC not in divide_ring(ring, angles, costs._replace(arc=np.inf)).kind
    assert ARC in divide_ring(ring[::-1].copy(), angles, costs).kind
    x = np.linspace(7.8, -7.8, 40)
    for sign in (1, -1):  # a bow outwards, and a hollow
        y = 10 + sign * (np.sqrt(18**2 - x**2) - np.sqrt(18**2 - 8**2))
        bent = np.vstack([np.column_stack([x, y]), *sides, base, right])
        assert (ARC in divide_ring(bent, angles, costs).kind) == (sign > 0)


@pytest.mark.parametrize("turn_deg", [0.0, 25.0, 90.0])
def test_a_wall_does_not_turn_back_at_the_end_of_a_narrow_wing(turn_deg):
    """The upper wall of a house and both sides of a wing, half a spacing wide, lie near one line."""
    house = [(4.5, 6), (1.5, 6), (0, 3), (0, 0), (3, 0), (6, 0), (6, 5)]
    wing = [(9, 5), (12, 5), (15, 5), (18, 5), (16.5, 6.5), (13.5, 6.5), (10.5, 6.5), (7.5, 6.5)]
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    traced = Outline(np.array(house + wing) @ np.array([[cos, sin], [-sin, cos]]))
    found = regularise_outline(traced)
    assert found.status is BuildingStatus.OK
    assert shapely.distance(found.outline.polygon, shapely.points(traced.exterior)).max() < 1.0


@pytest.mark.parametrize(("step", "n_walls"), [(0.0, 6), (5.0, 4)])
def test_the_division_is_the_best_of_all(step, n_walls):
    """Try every division of a small chain by brute force; two of its directions are nearly one."""
    rng = np.random.default_rng(0)
    box = shapely.segmentize(shapely.box(0, 0, 4, 3), 1.0)
    ring = shapely.get_coordinates(shapely.orient_polygons(box).exterior)[:-1]
    ring = ring + rng.normal(0, 0.05, ring.shape) + (0.0, 0.45) * (ring[:, :1] > 2)
    steps = {(0, 0), (1, 1), (2, 2), (1, 2), (2, 1)}
    angles = np.array([0.0, np.pi / 2, np.pi / 2 + 0.05])
    costs = Costs(0.1, 5.0, 15.0, step, parallel=0.1)

    def beyond(along, length):
        if len(along) < 2:
            return 0.0
        even = np.linspace(0.0, length, len(along)).std()
        return len(along) * max(along.std() - even, 0.0) ** 2 / costs.noise**2

    def cost(first, end, k):
        rows = ring[first:end] - ring[first:end].mean(axis=0)
        if k != FREE:
            along = rows @ (-np.sin(angles[k]), np.cos(angles[k]))
            across = np.sum((rows @ (np.cos(angles[k]), np.sin(angles[k]))) ** 2) / costs.noise**2
            return costs.wall + across + beyond(along, abs(along[-1] - along[0]))
        if end - first < 3:
            return np.inf
        least, ways = np.linalg.eigh(rows.T @ rows)
        more = beyond(rows @ ways[:, 1], np.hypot(*(rows[-1] - rows[0])))
        return costs.wall + costs.own_direction + least[0] / costs.noise**2 + more

    def cheapest(start, last):
        if start == len(ring):
            return 0.0
        key = (start, last)
        if key not in memory:
            memory[key] = min(
                cost(start, end, k) + (step if (k, last) in steps else 0.0) + cheapest(end, k)
                for end in range(start + 1, len(ring) + 1)
                for k in (0, 1, 2, FREE)
            )
        return memory[key]

    memory = {}
    walls = divide_ring(ring, angles, costs)
    ring = np.roll(ring, -int(walls.first[0]), axis=0)
    assert walls.cost == pytest.approx(cheapest(0, None))
    assert len(walls.first) == n_walls
