import numpy as np
import pytest

from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs
from lidar_buildings.core.stages.roof_selection.wet_roofs import find_wet_roofs

SPACING = 0.4
CONFIG = RoofSelectionConfig()
#: Middle, length and width of the place that returns nothing but a rim.
MIDDLE, SIZE = np.array([15.0, 12.0]), np.array([7.0, 5.0])


def local(points, angle_deg=0.0):
    cosine, sine = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return (points[:, :2] - MIDDLE) @ np.array([[cosine, -sine], [sine, cosine]])


def depth_within(points, angle_deg=0.0):
    """How far points lie within the rectangle, negative outside."""
    return (SIZE / 2 - np.abs(local(points, angle_deg))).min(axis=1)


def field(seed=0):
    """Flat ground of 30 × 24 m in jittered rows."""
    x, y = np.meshgrid(np.arange(0, 30, SPACING), np.arange(0, 24, SPACING))
    random = np.random.default_rng(seed)
    plan = np.column_stack([x.ravel(), y.ravel()]) + random.uniform(-0.1, 0.1, (x.size, 2))
    return np.column_stack([plan, random.normal(0, 0.02, x.size)])


def with_rim(top, angle_deg=0.0, width=0.35, inside=False):
    """A field whose rectangle is empty but for a rim of a width, `top` high along and across."""
    points = field()
    depth = depth_within(points, angle_deg)
    on_rim = (depth > 0) & (depth <= (np.inf if inside else width))
    points = points[(depth <= 0) | on_rim]
    on_rim = on_rim[(depth <= 0) | on_rim]
    points[on_rim, 2] += top(*local(points[on_rim], angle_deg).T)
    return points, on_rim


def found(points, is_roof=None, spacing=SPACING):
    is_roof = np.zeros(len(points), dtype=bool) if is_roof is None else is_roof
    return find_wet_roofs(points, points[:, 2], points[:, 2] > 0.5, is_roof, spacing, CONFIG)


@pytest.mark.parametrize("angle_deg", [0.0, 17.0, 30.0, 45.0])
@pytest.mark.parametrize("slope", [0.0, 0.1, 0.4])
def test_the_raised_rim_of_an_empty_rectangle_is_roof_whichever_way_it_lies(angle_deg, slope):
    points, on_rim = with_rim(lambda along, across: 3.5 + slope * across, angle_deg)
    rim = found(points)
    assert not rim[~on_rim].any()
    # A corner may be farther than the reach from what is empty for sure.
    assert rim[on_rim].mean() > 0.97


@pytest.mark.parametrize(
    ("top", "why"),
    [
        (lambda along, across: 0 * along, "a pond"),
        (lambda along, across: 1.2 + 0 * along, "a basin lower than a building"),
        (lambda along, across: np.random.default_rng(1).uniform(2, 6, len(along)), "a gap between crowns"),
        (lambda along, across: np.where(across > 1.5, 6.0, 0.0), "a shadow beside a building"),
        (lambda along, across: np.where(np.abs(across) > 2.0, 3.0, 0.0), "an alley between two buildings"),
    ],
)
def test_other_empty_places_have_no_roof_around_them(top, why):
    assert not found(with_rim(top)[0]).any(), why


def test_leaves_beside_the_rim_do_not_hide_it_and_are_not_taken():
    points, on_rim = with_rim(lambda along, across: 3.0 + 0 * along)
    random = np.random.default_rng(2)
    at_end = on_rim & (local(points)[:, 0] > 3.0)
    leaves = points[at_end] + np.column_stack(
        [np.full((at_end.sum(), 2), 0.3), random.uniform(0.6, 2, at_end.sum())]
    )
    result = found(np.vstack([points, leaves]))
    assert result[: len(points)][on_rim].all()
    assert not result[len(points) :].any()


def test_a_place_with_returns_inside_is_not_empty():
    points, _ = with_rim(lambda along, across: 3.0 + 0 * along)
    x, y = np.meshgrid(np.arange(12, 19, 1.2), np.arange(9.8, 15, 1.2))
    ground = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    assert not found(np.vstack([points, ground])).any()


def test_what_is_roof_already_counts_as_rim_and_is_not_found_again():
    points, on_rim = with_rim(lambda along, across: 3.0 + 0 * along)
    known = on_rim & (local(points)[:, 0] > 0)
    np.testing.assert_array_equal(found(points, known), on_rim & ~known)
    assert not found(points, on_rim).any()


def test_small_ones_are_no_buildings():
    points, _ = with_rim(lambda along, across: 3.0 + 0 * along)
    none = np.zeros(len(points), dtype=bool)
    larger = RoofSelectionConfig(min_building_area=60.0)
    assert not find_wet_roofs(points, points[:, 2], ~none, none, SPACING, larger).any()


def test_neither_order_nor_far_points_nor_cuts_change_the_result():
    points, on_rim = with_rim(lambda along, across: 3.0 + 0.2 * along, 20.0)
    shuffle = np.random.default_rng(3).permutation(len(points))
    np.testing.assert_array_equal(found(points[shuffle]), on_rim[shuffle])
    far = np.vstack([points, [[1e5, -1e5, 5.0]], points[:40] + np.array([300.0, 500.0, 4.0])])
    np.testing.assert_array_equal(found(far)[: len(points)], on_rim)
    near = np.abs(points[:, :2] - MIDDLE).max(axis=1) < 7.0
    np.testing.assert_array_equal(found(points[near]), on_rim[near])


@pytest.mark.parametrize("shift", [0.0, 512 * SPACING - 15.0, 1e4])
def test_it_does_not_matter_where_the_blocks_of_cells_end(shift):
    points, on_rim = with_rim(lambda along, across: 3.0 + 0 * along)
    np.testing.assert_array_equal(found(points + np.array([shift, shift, 0.0])), on_rim)


def test_the_stage_makes_the_rim_building_and_not_vegetation():
    points, on_rim = with_rim(lambda along, across: 3.0 + 0 * along)
    arguments = {
        "height_above_ground": points[:, 2],
        "classification": np.where(on_rim, 1, 2),
        "point_spacing": SPACING,
    }
    is_building = select_roofs(points, **arguments).classification == 6
    np.testing.assert_array_equal(is_building, on_rim)
