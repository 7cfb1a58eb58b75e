import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.regularisation.shared_walls import share_walls

GAP = 0.6


def outline(polygon):
    polygon = shapely.normalize(polygon)
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    return Outline(rings[0], tuple(rings[1:])).oriented()


def polygon(one):
    return shapely.Polygon(one.exterior, one.holes)


def shared(polygons, gap=GAP, traced=None):
    """Share walls; check what has to hold of every result as a message carries it."""
    outlines = [outline(one) for one in polygons]
    result = share_walls(outlines, outlines if traced is None else [outline(one) for one in traced], gap)
    found = np.array([polygon(one.as_carried()) for one in result.outlines], dtype=object)
    assert shapely.is_valid(found).all()
    assert shapely.coverage_is_valid(found)
    assert all(one.same_as(one.oriented()) for one in result.outlines)
    return result, found


def row_of_houses(n, seed, gap=0.4, turn_deg=0.3, angle_deg=0.0):
    """Houses side by side, a gap between them, each a little turned, fronts and backs not in line."""
    random = np.random.default_rng(seed)
    x = np.cumsum(np.append(0, random.uniform(5, 8, n)))
    front, back = random.uniform(0, 1.5, n), random.uniform(9, 11, n)
    houses = shapely.box(x[:-1] + gap / 2, front, x[1:] - gap / 2, back)
    turned = [shapely.affinity.rotate(one, random.normal(0, turn_deg)) for one in houses]
    return [shapely.affinity.rotate(one, angle_deg, origin=(0, 0)) for one in turned]


def cells_of(n, seed, size=30.0):
    """A square cut into the cells of n random places, which are drawn back and jittered a little."""
    random = np.random.default_rng(seed)
    places = shapely.MultiPoint(random.uniform(0, size, (n, 2)))
    block = shapely.box(0, 0, size, size)
    cells = shapely.intersection(shapely.get_parts(shapely.voronoi_polygons(places, extend_to=block)), block)
    drawn = shapely.get_exterior_ring(shapely.buffer(cells, -0.15, join_style="mitre"))
    corners = [shapely.get_coordinates(one)[:-1] for one in drawn]
    jittered = [shapely.Polygon(ring + random.uniform(-0.05, 0.05, ring.shape)) for ring in corners]
    return [
        one if one.is_valid else shapely.Polygon(ring) for one, ring in zip(jittered, corners, strict=True)
    ]


def closed(polygons):
    return shapely.union_all(polygons).buffer(GAP, join_style="mitre").buffer(-GAP, join_style="mitre")


def test_two_houses_meet_in_the_middle_of_their_gap():
    _, found = shared([shapely.box(0, 0, 5, 8), shapely.box(5.4, 0, 10, 8)])
    assert found[0].equals(shapely.Polygon([(0, 0), (5.2, 0), (5.2, 8), (0, 8)]).normalize()) or (
        shapely.hausdorff_distance(found[0], shapely.box(0, 0, 5.2, 8)) < 1e-6
    )
    assert shapely.hausdorff_distance(found[1], shapely.box(5.2, 0, 10, 8)) < 1e-6


def test_overlapping_houses_meet_in_the_middle_as_well():
    result, found = shared([shapely.box(0, 0, 5.2, 8), shapely.box(4.8, 0, 10, 8)])
    np.testing.assert_allclose(shapely.area(found), [40, 40], atol=1e-5)
    assert [len(one.exterior) for one in result.outlines] == [4, 4]


def test_the_longer_wall_has_the_greater_say():
    _, found = shared([shapely.box(0, 0, 5, 30), shapely.box(5.4, 10, 9, 13)])
    wall = found[1].bounds[0]
    assert 5.0 <= wall < 5.05


def test_where_three_meet_the_through_wall_gets_a_vertex():
    result, found = shared(
        [shapely.box(0, 0, 20, 6), shapely.box(0, 6.3, 9.8, 12), shapely.box(10.2, 6.3, 20, 12)]
    )
    assert [len(one.exterior) for one in result.outlines] == [5, 4, 4]
    common = set.intersection(*(set(map(tuple, one.exterior.tolist())) for one in result.outlines))
    assert len(common) == 1
    np.testing.assert_allclose(next(iter(common)), [10.0, 6.15], atol=0.01)
    assert shapely.union_all(found).geom_type == "Polygon"


def test_a_building_in_a_courtyard_shares_its_rim():
    court = shapely.box(0, 0, 20, 20).difference(shapely.box(6, 6, 14, 14))
    result, found = shared([court, shapely.box(6.3, 6.3, 13.7, 13.7)])
    hole, inner = result.outlines[0].holes[0], result.outlines[1].exterior
    assert set(map(tuple, hole.tolist())) == set(map(tuple, inner.tolist()))
    assert shapely.union_all(found).interiors[:] == []


def test_a_building_under_another_one_cuts_its_courtyard():
    _, found = shared([shapely.box(0, 0, 20, 20), shapely.box(6, 6, 10, 10)])
    assert len(found[0].interiors) == 1
    assert found[1].area == pytest.approx(16.0)


def test_what_the_points_say_decides_whose_an_overlap_is():
    outlines = [shapely.box(0, 0, 11, 10), shapely.box(9, 2, 20, 8)]
    traced = [shapely.box(0, 0, 11, 10), shapely.box(11.3, 2, 20, 8)]
    _, found = shared(outlines, traced=traced)
    assert found[0].area == pytest.approx(110.0)


def test_a_crooked_gap_is_closed_too():
    zigzag = [(5, 0), (5.3, 1), (5, 2), (5.3, 3), (5, 4)]
    west = shapely.Polygon([(0, 4), (0, 0), *zigzag])
    east = shapely.Polygon([(10, 0), (10, 4), *((x + 0.3, y) for x, y in zigzag[::-1])])
    _, found = shared([west, east])
    union = shapely.union_all(found)
    assert union.geom_type == "Polygon"
    assert union.area == pytest.approx(40.0, abs=0.3)


def test_buildings_farther_apart_are_not_touched():
    outlines = [outline(one) for one in (shapely.box(0, 0, 5, 8), shapely.box(5.7, 0, 9, 8))]
    result = share_walls(outlines, outlines, GAP)
    assert all(after is before for after, before in zip(result.outlines, outlines, strict=True))
    assert result.reasons == ("", "")


def test_walls_that_face_no_other_building_stay_where_they_are():
    tower = shapely.Point(-4, 4).buffer(4.3)
    west = shapely.union(shapely.box(-4, 0, 5, 8), tower)
    _, found = shared([west, shapely.box(5.4, 0, 10, 8)])
    before = {tuple(p) for p in shapely.get_coordinates(west).astype(np.float32).tolist() if p[0] < 5}
    assert before <= {tuple(p) for p in shapely.get_coordinates(found[0]).tolist()}


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 77.0])
def test_a_row_of_houses_becomes_one_body_of_straight_walls(angle_deg):
    houses = row_of_houses(20, 1, angle_deg=angle_deg)
    result, found = shared(houses)
    assert set(result.reasons) == {""}
    union = shapely.union_all(found)
    assert union.geom_type == "Polygon"
    assert not union.interiors
    # Nothing but the gaps is added, of 0.4 m each and some degrees of turn.
    assert abs(union.area - closed(houses).area) < 0.02 * union.area
    # Four corners, and at most one on either end of either party wall.
    assert max(len(one.exterior) for one in result.outlines) <= 8
    assert np.abs(shapely.area(found) / shapely.area(houses) - 1).max() < 0.12


@pytest.mark.parametrize("seed", range(8))
def test_random_partitions_are_put_together_again(seed):
    cells = cells_of(12, seed)
    result, found = shared(cells)
    kept = [reason == "" for reason in result.reasons]
    assert np.mean(kept) > 0.9
    assert shapely.union_all(found).area == pytest.approx(900.0, rel=0.03)


@settings(max_examples=40)
@given(
    n=st.integers(1, 7),
    seed=st.integers(0, 10_000),
    gap=st.floats(-0.5, 0.9),
    turn_deg=st.floats(0, 5),
    angle_deg=st.floats(0, 360),
)
def test_any_row_gives_valid_outlines_whatever_the_order(n, seed, gap, turn_deg, angle_deg):
    houses = row_of_houses(n, seed, gap, turn_deg, angle_deg)
    outlines = [outline(one) for one in houses]
    result = share_walls(outlines, outlines, GAP)
    found = np.array([polygon(one.as_carried()) for one in result.outlines], dtype=object)
    assert shapely.is_valid(found).all()
    if set(result.reasons) == {""}:
        assert shapely.coverage_is_valid(found)
    order = np.random.default_rng(seed).permutation(n)
    begun = [Outline(np.roll(outlines[k].exterior, 1, axis=0)) for k in order]
    other = share_walls(begun, begun, GAP)
    for k, one in zip(order, other.outlines, strict=True):
        assert set(map(tuple, one.exterior.tolist())) == set(map(tuple, result.outlines[k].exterior.tolist()))


def test_sharing_twice_changes_nothing():
    first, _ = shared(row_of_houses(8, 3))
    second = share_walls(first.outlines, first.outlines, GAP)
    assert all(a.same_as(b) for a, b in zip(second.outlines, first.outlines, strict=True))


def test_a_building_narrower_than_the_gap_is_not_squeezed_out():
    houses = [shapely.box(0, 0, 5, 8), shapely.box(5.05, 0, 5.35, 8), shapely.box(5.4, 0, 10, 8)]
    _, found = shared(houses, gap=1.2)
    assert found[1].area > 0.9 * houses[1].area


def test_a_building_that_would_be_lost_keeps_its_outline_and_says_so():
    outlines = [outline(shapely.box(0, 0, 20, 20)), outline(shapely.box(6, 6, 10, 10))]
    traced = [outlines[0], outline(shapely.box(30, 30, 31, 31))]
    result = share_walls(outlines, traced, GAP)
    assert result.outlines[0] is outlines[0]
    assert result.outlines[1] is outlines[1]
    assert result.reasons == ("", "sharing walls would leave nothing of it or several parts")


def test_an_invalid_outline_stays_as_it_is_and_hinders_no_other():
    bow = Outline(np.array([[0.0, 0], [4, 4], [4, 0], [0, 4]]))
    outlines = [
        bow,
        outline(shapely.box(4.2, 0, 9, 8)),
        outline(shapely.box(9.3, 0, 14, 8)),
        Outline(np.zeros((0, 2))),
    ]
    result = share_walls(outlines, outlines, GAP)
    assert result.outlines[0] is bow
    assert result.outlines[3] is outlines[3]
    assert result.reasons == ("the outline is not valid", "", "", "the outline is not valid")
    assert shapely.coverage_is_valid([polygon(one) for one in result.outlines[1:3]])


def test_no_buildings_and_one_are_legal():
    assert share_walls([], [], GAP).outlines == ()
    one = outline(shapely.box(0, 0, 5, 8))
    assert share_walls([one], [one], [0.3]).outlines == (one,)


def test_corners_that_cross_where_gaps_are_closed_are_no_error():
    one = shapely.Polygon([(1.2, 6.7), (2.5, -0.5), (5.3, -5.1), (6.4, -1.7)])
    other = shapely.Polygon([(14.1, 8.3), (-1, 7.8), (15, 2.2), (16.4, 4.4), (12.6, 7)])
    grown = shapely.union_all([one, other]).buffer(2.0, join_style="mitre")
    assert not grown.buffer(-2.0, join_style="mitre").is_valid  # GEOS's; else this tests nothing
    result, _ = shared([one, other], gap=4.0)
    assert len(result.outlines) == 2
