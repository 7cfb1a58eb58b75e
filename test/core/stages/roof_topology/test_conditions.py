"""What planes of roofs with known truth have in common is found, and what they have not is refused."""

import numpy as np
import pytest

from bench.scenes.kit import scan_rows
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.roof_topology.topology import find_topology
from lidar_buildings.core.surfaces.plane_adjustment import ALIKE, EAVES, adjust

LENGTH, WIDTH, SLOPE, EAVE = 24.0, 10.0, 0.8, 5.0
CORNERS = 0.5 * np.array([(-LENGTH, -WIDTH), (LENGTH, -WIDTH), (LENGTH, WIDTH), (-LENGTH, WIDTH)])
#: z = a x + b y + c of both sides; the second falls to the north.
SIDES = np.array([(0.0, SLOPE, EAVE + 0.5 * SLOPE * WIDTH), (0.0, -SLOPE, EAVE + 0.5 * SLOPE * WIDTH)])
#: Dormers on the south side: where their fronts stand, and half their widths [m].
FRONT, HALF = -4.0, 1.2


def planes_of(dormers, raised=(0.0, 0.0)):
    """Return a, b, c of the planes of a gable with dormers, and those of which each place has the highest."""
    planes = SIDES + np.outer(raised, (0.0, 0.0, 1.0))
    owner = [()]
    for x, side_slope, front_slope, height in dormers:
        # At x the ridge, or any place of a shed dormer, is so high at the front.
        top = (0.0, front_slope, height - front_slope * FRONT)
        sides = [(-side_slope, 0.0, side_slope * x), (side_slope, 0.0, -side_slope * x)]
        own = [np.add(top, side) for side in (sides if side_slope else sides[:1])]
        owner.append((x, range(len(planes) + 1, len(planes) + 1 + len(own))))
        planes = np.vstack([planes, *own])
    return planes, owner[1:]


def seen(planes, owner, seed, density=10.0, noise=0.03):
    """Return the points of a roof, their planes and its outline, turned by an angle; and the true planes."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0.0, np.pi / 2.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    xy = scan_rows(np.full(2, -15.0), np.full(2, 15.0), density, random) @ turn
    xy = xy[(np.abs(xy) < (0.5 * LENGTH, 0.5 * WIDTH)).all(axis=1)]
    z = xy @ planes[:, :2].T + planes[:, 2]
    plane_id = z[:, :2].argmin(axis=1) + 1
    for x, numbers in owner:
        rows = np.array(numbers) - 1
        lowest = rows[z[:, rows].argmin(axis=1)]
        inside = (np.abs(xy[:, 0] - x) < HALF) & (xy[:, 1] > FRONT) & (xy[:, 1] < 0.0)
        higher = inside & (np.take_along_axis(z, lowest[:, None], 1)[:, 0] > z[:, :2].min(axis=1))
        plane_id[higher] = lowest[higher] + 1
    height = np.take_along_axis(z, plane_id[:, None] - 1, 1)[:, 0]
    points = np.column_stack([xy @ turn.T, height + random.normal(0.0, noise, len(xy))])
    true = np.column_stack([planes[:, :2] @ turn.T, planes[:, 2]])
    return points, plane_id.astype(np.uint16), Outline(CORNERS @ turn.T), true


def kinds(conditions, kind):
    return [one.planes for one in conditions if one.kind == kind]


@pytest.mark.parametrize(("raised", "is_held"), [(0.0, True), (0.05, True), (0.25, False), (1.0, False)])
def test_eaves_are_at_one_height_unless_they_are_clearly_not(raised, is_held):
    """One side of the gable, and so its eaves, is raised: the ridge is out of the middle."""
    errors = []
    for seed in range(5):
        points, plane_id, outline, true = seen(*planes_of((), (0.0, raised)), seed)
        topology = find_topology(points, plane_id, outline)
        assert kinds(topology.held, EAVES) == [(1, 2)] * is_held
        assert kinds(topology.refused, EAVES) == [(1, 2)] * (not is_held)
        for plane, (a, b, c) in zip(topology.planes, true, strict=True):
            errors.append(plane.elevation(outline.exterior) - (outline.exterior @ (a, b) + c))
    # Eaves that are not, but may be at one height, do not move planes that are surer.
    assert np.sqrt(np.mean(np.square(errors))) < 0.01


ROW = (-8.0, 0.0, 8.0)


@pytest.mark.parametrize(("side_slope", "front_slope"), [(0.0, 0.25), (1.2, 0.0)], ids=["shed", "gable"])
def test_dormers_in_a_row_are_alike_and_nearer_to_the_truth_for_it(side_slope, front_slope):
    squares, n_held, n_refused = np.zeros(2), 0, 0
    for seed in range(6):
        planes, owner = planes_of([(x, side_slope, front_slope, 7.3) for x in ROW])
        points, plane_id, outline, true = seen(planes, owner, seed, density=20.0)
        topology = find_topology(points, plane_id, outline)
        held, refused = (kinds(group, ALIKE) for group in (topology.held, topology.refused))
        pairs = {(3, 5), (5, 7), (4, 6), (6, 8)} if side_slope else {(3, 4), (4, 5)}
        assert {*held, *refused} == pairs
        n_held, n_refused = n_held + len(held), n_refused + len(refused)
        for found, which in ((adjust(points, plane_id).planes, 0), (topology.planes, 1)):
            for k in range(2, len(true)):
                middle = points[plane_id == k + 1, :2].mean(axis=0)
                places = middle + HALF * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
                off = found[k].elevation(places) - (places @ true[k, :2] + true[k, 2])
                squares[which] += np.mean(off**2)
    assert n_refused <= 0.05 * n_held
    assert squares[1] < 0.6 * squares[0]


@pytest.mark.parametrize("odd", [(8.0, 0.0, 0.25, 7.7), (8.0, 0.0, 0.37, 7.3)], ids=["higher", "steeper"])
def test_a_dormer_that_is_not_like_the_others_stays_as_it_is(odd):
    planes, owner = planes_of([(-8.0, 0.0, 0.25, 7.3), (0.0, 0.0, 0.25, 7.3), odd])
    points, plane_id, outline, true = seen(planes, owner, 1)
    topology = find_topology(points, plane_id, outline)
    assert kinds(topology.held, ALIKE).count((3, 4)) == 2
    assert (4, 5) in kinds(topology.refused, ALIKE)
    middle = points[plane_id == 5, :2].mean(axis=0)[None]
    expected = middle[0] @ true[4, :2] + true[4, 2]
    assert topology.planes[4].elevation(middle)[0] == pytest.approx(expected, abs=0.03)
