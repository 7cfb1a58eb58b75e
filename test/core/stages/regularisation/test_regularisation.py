import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.scenes.buildings import GALLERY
from bench.scenes.outlines import ROTATIONS as ALL_ROTATIONS
from bench.scenes.outlines import Scan, outline_scenes
from lidar_buildings.core.model.outline import Outline, signed_area
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.stages.boundary_tracing.tracing import trace_boundary
from lidar_buildings.core.stages.regularisation.config import AS_PUBLISHED, RegularisationConfig
from lidar_buildings.core.stages.regularisation.regularising import outline_quality, regularise_outline

CORNERS = {"flat": 4, "gable": 4, "hip": 4, "step_roof": 4, "l_shape": 6, "t_shape": 8, "courtyard": 4}
ROTATIONS = (0.0, 17.0, 45.0, 78.0)


def polygon(outline):
    return shapely.Polygon(outline.exterior, outline.holes)


def overlap(one, other):
    return one.intersection(other).area / one.union(other).area


def turned(xy, angle_deg):
    angle = np.deg2rad(angle_deg)
    return xy @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def noisy_ring(corners, step=0.5, noise=0.1, seed=0):
    """Points along a polygon's edges, moved about at random."""
    rng = np.random.default_rng(seed)
    parts = []
    for a, b in zip(np.array(corners, float), np.roll(corners, -1, axis=0), strict=True):
        t = np.arange(0.0, 1.0, step / np.hypot(*(b - a)))[:, None]
        parts.append(a + t * (b - a))
    ring = np.vstack(parts)
    return ring + rng.normal(0, noise, ring.shape)


def corner_angles_deg(ring):
    edges = np.roll(ring, -1, axis=0) - ring
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    return np.rad2deg(np.abs((np.diff(heading, append=heading[:1]) + np.pi) % (2 * np.pi) - np.pi))


@pytest.mark.parametrize("rotation_deg", ROTATIONS)
@pytest.mark.parametrize("name", CORNERS)
def test_a_rectilinear_house_gets_its_number_of_corners_all_of_them_right_angles(name, rotation_deg):
    scene = GALLERY[name](rotation_deg=rotation_deg)
    traced = trace_boundary(scene.roof_points())
    result = regularise_outline(traced.outline)
    assert (result.status, result.reason) == (BuildingStatus.OK, "")
    assert len(result.outline.exterior) == CORNERS[name]
    assert np.allclose(corner_angles_deg(result.outline.exterior), 90.0, atol=1.0)
    assert overlap(polygon(result.outline), scene.buildings[0].polygon) > 0.93
    # Half a degree is the accuracy of a 10 m wall's direction at this density.
    error = (np.rad2deg(result.directions[0]) - rotation_deg + 45.0) % 90.0 - 45.0
    assert abs(error) < 1.0
    # The paper finds 0.2 spacings and about one; our points are random, theirs are on scan lines.
    assert result.sigma < 0.5 * traced.point_spacing
    assert result.max_offset < 2.0 * traced.point_spacing


def test_a_courtyard_keeps_its_four_corners_inside():
    (scene,) = outline_scenes(names=["courtyard"], rotations=(30.0,))
    outline = regularise_outline(trace_boundary(scene.points).outline).outline
    assert [len(ring) for ring in outline.rings] == [4, 4]
    assert signed_area(outline.exterior) > 0 > signed_area(outline.holes[0])
    assert polygon(outline).is_valid


@pytest.mark.parametrize("density", [0.5, 2.0, 30.0])
def test_an_l_shaped_house_has_six_corners_at_any_density(density):
    scene = GALLERY["l_shape"](density=density, rotation_deg=25.0)
    outline = regularise_outline(trace_boundary(scene.roof_points()).outline).outline
    assert len(outline.exterior) == 6


def test_a_round_tower_is_one_arc_with_its_centre_and_radius():
    for scene in outline_scenes(names=["round_tower_4", "round_tower_8"], rotations=(0.0, 75.0)):
        traced = trace_boundary(scene.points)
        ring = regularise_outline(traced.outline).outline.exterior
        centre = ring.mean(axis=0)
        radius = np.hypot(*(ring - centre).T)
        assert np.allclose(radius, radius[0])
        (arc,) = scene.arcs
        assert np.hypot(*(centre - arc.centre)) < 0.2 * scene.spacing
        # Points lie inside the edge by less than a spacing, vertices outside the arc by less than its error.
        assert -0.1 < (arc.radius - radius[0]) / scene.spacing < 0.5


def test_chords_leave_an_arc_by_no_more_than_asked_for_and_are_no_shorter_than_a_wall():
    (scene,) = outline_scenes(names=["round_tower_8"], rotations=(0.0,))
    traced = trace_boundary(scene.points).outline
    counts = []
    for chord_error in (0.05, 0.2, 1.0):
        config = RegularisationConfig(chord_error=chord_error, finest_spacing=0.0)
        ring = regularise_outline(traced, config).outline.exterior
        middles, centre = 0.5 * (ring + np.roll(ring, -1, axis=0)), ring.mean(axis=0)
        # Vertices lie outside the arc as far as the middles of chords lie inside.
        sagitta = np.hypot(*(ring[0] - centre)) - np.hypot(*(middles - centre).T).min()
        assert 0 < sagitta <= 2.0 * chord_error * scene.spacing * 1.1
        counts.append(len(middles))
    assert counts[0] > counts[1] > counts[2]
    ring = regularise_outline(traced, RegularisationConfig(chord_error=0.01)).outline.exterior
    chords = np.hypot(*(ring - np.roll(ring, 1, axis=0)).T)
    assert (chords >= 1.0).all()
    assert (chords < 1.1).all()


def test_an_apse_is_an_arc_between_straight_walls_and_none_if_arcs_are_not_wanted():
    (scene,) = outline_scenes(names=["apse"], rotations=(30.0,))
    traced = trace_boundary(scene.points).outline
    ring = regularise_outline(traced).outline.exterior
    away = np.abs(np.hypot(*(ring - scene.arcs[0].centre).T) - scene.arcs[0].radius)
    n_on_arc = np.count_nonzero(away < scene.spacing)
    assert len(ring) - n_on_arc == 2
    assert n_on_arc > 4
    straight = regularise_outline(traced, RegularisationConfig(curved_walls=False))
    assert len(straight.outline.exterior) < len(ring)
    assert overlap(polygon(straight.outline), scene.truth) > 0.93


def test_a_slanting_wall_keeps_its_direction():
    ring = noisy_ring([(0, 0), (20, 0), (20, 8), (12, 16), (0, 16)])
    result = regularise_outline(Outline(ring))
    assert len(result.outline.exterior) == 5
    angles = sorted(corner_angles_deg(result.outline.exterior))
    assert np.allclose(angles, [45, 45, 90, 90, 90], atol=3.0)


def test_wings_at_an_odd_angle_have_directions_of_their_own():
    bend = turned(np.array([(0, 0), (20, 0), (20, 8), (0, 8)]), 33.0) + np.array([20, 0])
    wings = shapely.union(shapely.box(0, -8, 21, 1), shapely.Polygon(bend))
    ring = noisy_ring(shapely.get_coordinates(wings.exterior)[:-1])
    result = regularise_outline(Outline(ring).oriented())
    found = np.rad2deg(result.directions)
    for expected in (0.0, 33.0):
        assert np.abs((found - expected + 45) % 90 - 45).min() < 1.5


def test_scan_stairs_disappear_and_real_steps_stay():
    corners = [(0, 0), (20, 0), (20, 10), (10, 10), (10, 12), (0, 12)]
    assert len(regularise_outline(Outline(noisy_ring(corners))).outline.exterior) == 6
    # A rectangle 20° askew to the scan lines: the ring goes up in stairs.
    x, y = np.meshgrid(np.arange(-20.0, 20.0, 0.3), np.arange(-20.0, 20.0, 0.6))
    lines = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    u, v = turned(lines[:, :2], -20.0).T
    traced = trace_boundary(lines[(np.abs(u) < 9.0) & (np.abs(v) < 5.0)])
    outline = regularise_outline(traced.outline).outline
    assert len(outline.exterior) == 4
    assert np.rad2deg(regularise_outline(traced.outline).directions[0]) == pytest.approx(20.0, abs=1.5)


@pytest.mark.parametrize("correct_bias", [False, True])
@pytest.mark.parametrize("set_back", [0.0, 0.4])
def test_walls_beside_an_annex_lie_on_one_line_unless_one_is_set_back(set_back, correct_bias):
    left = 10.0 - set_back
    corners = [(0, 0), (24, 0), (24, 10), (16, 10), (16, 14), (8, 14), (8, left), (0, left)]
    ring = turned(noisy_ring(corners, seed=3), 17.0)
    found = regularise_outline(
        Outline(ring), RegularisationConfig(correct_bias=correct_bias)
    ).outline.exterior
    assert len(found) == 8
    ends = turned(np.array([(24, 10), (16, 10), (8, left), (0, left)]), 17.0)
    right, *inner, far = found[[np.hypot(*(found - end).T).argmin() for end in ends]]
    offsets = shapely.distance(shapely.LineString([right, far]), shapely.points(inner))
    assert offsets == pytest.approx([set_back / 3] * 2, abs=1e-9 if set_back == 0.0 else 0.05)


def test_a_long_wall_turns_as_its_points_say_and_goes_on_so_beyond_an_annex():
    """A house 1° from square: its front, an annex before the middle, is one line of its own direction."""
    front = [(0, 0), (10, 0), (10, -3), (16, -3), (16, 0), (26, 0)]
    slope = np.tan(np.deg2rad(1.0))
    corners = [(x, y + slope * x) for x, y in front] + [(26, 12), (0, 12)]
    found = regularise_outline(Outline(noisy_ring(corners, step=0.47, noise=0.05))).outline.exterior
    assert len(found) == 8
    ends = [found[np.hypot(*(found - (x, slope * x)).T).argmin()] for x in (0, 10, 16, 26)]
    turns = np.rad2deg([np.arctan2(b[1] - a[1], b[0] - a[0]) for a, b in (ends[:2], ends[2:], ends[::3])])
    assert turns == pytest.approx([turns[0]] * 3, abs=1e-6)
    assert turns[0] == pytest.approx(1.0, abs=0.4)
    away = shapely.distance(shapely.LineString(ends[::3]), shapely.points(ends[1:3]))
    assert away == pytest.approx([0.0, 0.0], abs=1e-9)


def test_the_outline_turns_and_moves_with_the_ring():
    ring = trace_boundary(GALLERY["t_shape"]().roof_points()).outline.exterior
    expected = regularise_outline(Outline(ring)).outline.exterior
    for angle_deg, shift in ((31.0, (0.0, 0.0)), (90.0, (500.0, -900.0)), (211.0, (0.0, 3e4))):
        moved = regularise_outline(Outline(turned(ring, angle_deg) + shift)).outline
        assert overlap(polygon(moved), shapely.Polygon(turned(expected, angle_deg) + shift)) > 0.99


@pytest.mark.parametrize(
    ("ring", "reason"),
    [
        (np.zeros((0, 2)), "too few"),
        (np.array([(0, 0), (1, 0), (0, 1)]), "too few"),
        (np.zeros((30, 2)), ""),
        (np.column_stack([np.arange(30.0), np.zeros(30)]), ""),
    ],
)
def test_what_cannot_be_regularised_is_returned_as_traced_with_a_reason(ring, reason):
    traced = Outline(np.asarray(ring, dtype=np.float64))
    result = regularise_outline(traced)
    assert result.status is BuildingStatus.TRACED_OUTLINE
    assert result.outline.same_as(traced)
    assert result.reason
    assert reason in result.reason
    assert (result.sigma, result.max_offset) == (0.0, 0.0)


@settings(max_examples=80)
@given(arrays(np.float32, st.tuples(st.integers(9, 80), st.just(2)), elements=st.floats(-50, 50, width=16)))
def test_any_cloud_gets_a_valid_outline(xy):
    traced = trace_boundary(np.column_stack([xy.astype(np.float64), np.zeros(len(xy))]))
    result = regularise_outline(traced.outline)
    assert polygon(result.outline).is_valid
    assert polygon(result.outline).area > 0
    if result.status is BuildingStatus.TRACED_OUTLINE:
        assert result.reason
        assert sum(map(len, result.outline.rings)) <= sum(map(len, traced.outline.rings))


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 45.0])
def test_where_walls_would_cross_at_a_neck_the_ring_is_followed_and_nowhere_else(angle_deg):
    blocks = shapely.union_all([shapely.box(0, 0, 12, 10), shapely.box(12.2, 10.2, 24, 20)])
    bridge = shapely.Polygon([(11.8, 9.9), (12.4, 10.2), (12.3, 10.4), (11.7, 10.0)])
    whole = shapely.union(blocks, bridge)
    ring = shapely.get_coordinates(shapely.segmentize(whole.exterior, 0.4))[:-1]
    result = regularise_outline(Outline(turned(ring, angle_deg)).oriented())
    assert result.status is BuildingStatus.OK
    assert "walls would cross follow the points: 1" in result.reason
    assert len(result.outline.exterior) <= 12
    truth = shapely.Polygon(turned(shapely.get_coordinates(whole), angle_deg))
    assert overlap(polygon(result.outline), truth) > 0.98


def test_rings_whose_walls_make_up_no_polygon_stay_as_traced_but_for_what_is_no_step():
    box = shapely.box(0.0, 0.0, 0.7, 0.6)  # shorter than walls are
    ring = shapely.get_coordinates(shapely.segmentize(box.exterior, 0.1))[:-1]
    result = regularise_outline(Outline(ring).oriented())
    assert result.status is BuildingStatus.TRACED_OUTLINE
    assert result.reason
    assert 3 <= len(result.outline.exterior) <= 6
    assert overlap(polygon(result.outline), shapely.Polygon(ring)) > 0.6


def test_the_quality_is_that_of_the_adjustment_or_of_the_outline_put_in_its_place():
    config = RegularisationConfig()
    traced = trace_boundary(GALLERY["hip"]().roof_points()).outline
    result = regularise_outline(traced)
    adjusted = outline_quality(traced, result.outline.as_carried(), result, config)
    assert (adjusted.sigma, adjusted.max_offset) == (result.sigma, result.max_offset)
    assert adjusted.status is BuildingStatus.OK
    moved = outline_quality(traced, Outline(result.outline.exterior + 0.5), result, config)
    assert moved.sigma > result.sigma
    kept = outline_quality(traced, traced, result, config)
    assert kept.status is BuildingStatus.TRACED_OUTLINE
    assert kept.reason


def test_nearly_all_buildings_of_right_angles_get_their_number_of_corners_in_all_orientations():
    names = ["rectangle_8_6", "l_shape", "staircase", "courtyard", "facade_step", "comb"]
    right = []
    for scene in outline_scenes(names=names, rotations=ALL_ROTATIONS[::3]):
        result = regularise_outline(trace_boundary(scene.points).outline)
        right.append(sum(map(len, result.outline.rings)) == scene.n_corners)
        assert overlap(polygon(result.outline), scene.truth) > 0.93
    assert np.mean(right) >= 0.95


def test_the_bias_correction_moves_walls_to_where_they_are():
    scenes = outline_scenes(names=["rectangle_14_10", "u_shape"], rotations=ALL_ROTATIONS[::4])
    errors = {False: [], True: []}
    for scene in scenes:
        traced = trace_boundary(scene.points).outline
        for correct, found in errors.items():
            result = regularise_outline(traced, RegularisationConfig(correct_bias=correct))
            missing = scene.truth.area - polygon(result.outline).area
            found.append(missing / scene.truth.length / scene.spacing)
    assert np.mean(errors[False]) > 0.05
    assert abs(np.mean(errors[True])) < 0.05


def test_the_published_method_knows_two_perpendicular_directions_and_nothing_else():
    for scene in outline_scenes(names=["l_shape", "rectangle_30_18"], rotations=(0.0, 37.5)):
        result = regularise_outline(trace_boundary(scene.points).outline, AS_PUBLISHED)
        assert len(result.directions) == 1
        assert overlap(polygon(result.outline), scene.truth) > 0.9
        angles = corner_angles_deg(result.outline.exterior)
        assert np.median(np.abs(angles - 90.0)) < 2.0
    (hexagon,) = outline_scenes(names=["hexagon"], rotations=(0.0,))
    wrong = regularise_outline(trace_boundary(hexagon.points).outline, AS_PUBLISHED)
    assert len(wrong.directions) == 1
    assert len(wrong.outline.exterior) != 6


@pytest.mark.parametrize("bend_deg", [4.0, 8.0, 12.0, 14.0, 20.0])
def test_a_long_bar_that_bends_a_little_keeps_its_six_corners(bend_deg):
    turn = np.deg2rad(bend_deg)
    wing = shapely.affinity.rotate(shapely.box(0, -6, 40, 6), turn, origin=(0, 6), use_radians=True)
    wedge = shapely.Polygon([(0, 6), (-0.01, -6), (12 * np.sin(turn), 6 - 12 * np.cos(turn))])
    bar = shapely.union_all([shapely.box(-40, -6, 0, 6), wing, wedge])
    points = Scan(20.0, 1.3, 0.2).over(bar, 8.0, np.random.default_rng(0))
    result = regularise_outline(trace_boundary(np.column_stack([points, np.zeros(len(points))])).outline)
    assert result.status is BuildingStatus.OK
    assert len(result.outline.exterior) == 6
    assert overlap(polygon(result.outline), bar) > 0.95


def test_no_edge_is_much_shorter_than_the_smallest_step():
    for scene in outline_scenes(
        names=["chamfered", "three_wings", "facade_step"], rotations=ALL_ROTATIONS[::2]
    ):
        traced = trace_boundary(scene.points)
        outline = regularise_outline(traced.outline).outline
        for ring in outline.rings:
            edges = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
            assert edges.min() > 0.6 * traced.point_spacing


def test_repeated_vertices_types_and_orientation_make_no_difference():
    ring = trace_boundary(GALLERY["l_shape"](rotation_deg=12.0).roof_points()).outline.exterior
    expected = regularise_outline(Outline(ring))
    for other in (np.repeat(ring, 2, axis=0), ring.tolist(), np.vstack([ring, ring[:1]])):
        again = regularise_outline(Outline(other))
        assert again.outline.same_as(expected.outline)
    turned_round = regularise_outline(Outline(ring[::-1])).outline
    assert overlap(polygon(turned_round), polygon(expected.outline)) > 0.995


def test_courtyards_of_hardly_any_vertices_leave_the_outline_as_traced():
    ring = trace_boundary(GALLERY["flat"]().roof_points()).outline.exterior
    middle = ring.mean(axis=0)
    for hole in (np.zeros((0, 2)), middle[None], np.array([middle, middle + 1.0])):
        result = regularise_outline(Outline(ring, (hole,)))
        assert result.status is BuildingStatus.TRACED_OUTLINE
        assert "courtyard" in result.reason


def test_a_courtyard_that_the_outer_walls_meet_is_left_out_and_said():
    # a bulge that walls cut off reaches round a courtyard
    side = np.arange(0.0, 20.0)
    ring = np.concatenate(
        [
            np.column_stack([side, 0.0 * side]),
            np.column_stack([0.0 * side + 20.0, side]),
            np.column_stack([20.0 - side, 0.0 * side + 20.0]),
            np.column_stack([0.0 * side, 20.0 - side]),
        ]
    )
    inside = np.array([[5.0, 5.0], [5.0, 9.0], [9.0, 9.0], [9.0, 5.0]])
    beyond = np.array([[13.0, 17.0], [13.0, 20.4], [16.0, 20.4], [16.0, 17.0]])
    bulge = np.concatenate([ring[:44], [[16.5, 20.6], [14.5, 20.6], [12.5, 20.6]], ring[48:]])
    traced = Outline(bulge, (inside, beyond))
    assert traced.polygon.is_valid
    found = regularise_outline(traced)
    assert found.outline.polygon.is_valid
    assert found.status is BuildingStatus.OK
    assert "left out because the outer walls meet them: 1" in found.reason
    [hole] = found.outline.holes
    assert shapely.Polygon(hole).intersects(shapely.Point(7.0, 7.0))
