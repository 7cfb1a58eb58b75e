import math

import numpy as np
import pytest

from lidar_buildings.core.neighbours.scan_pattern import ScanPattern, as_pulses
from lidar_buildings.core.stages.segmentation.config import AS_PUBLISHED, SegmentationConfig
from lidar_buildings.core.stages.segmentation.segmentation import segment_buildings
from lidar_buildings.core.stages.segmentation.windows import SLACK, chain_along_scan, chain_windows

KEEP_ALL = SegmentationConfig(min_points=1, min_area=0.0, min_neck=0.0)


def grown_as_published(xy, pattern, window):
    """The paper's ten steps, point by point: the oracle. Quadratic."""
    cos, sin = math.cos(pattern.direction), math.sin(pattern.direction)
    half_along, half_across = (window / 2 * side * (1 + 1e-6) for side in (pattern.along, pattern.across))
    label = np.zeros(len(xy), dtype=int)
    for start in range(len(xy)):
        if label[start]:
            continue
        label[start] = label.max() + 1
        front = [start]
        while front:
            dx, dy = (xy - xy[front.pop()]).T
            inside = (np.abs(dx * cos + dy * sin) <= half_along) & (
                np.abs(dy * cos - dx * sin) <= half_across
            )
            new = np.flatnonzero(inside & (label == 0))
            label[new] = label[start]
            front += new.tolist()
    return label


def partition(labels):
    return {frozenset(np.flatnonzero(labels == label).tolist()) for label in np.unique(labels)}


def scanned_houses(along, across, turn, *, jitter=0.0, size=40.0, share=0.45, seed=0):
    """Lines of pulses on houses at random places."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.arange(0, size, along), np.arange(0, size, across))
    flat = np.column_stack((u.ravel(), v.ravel()))
    block = 8 * max(along, across)
    is_roof = rng.random((99, 99)) < share
    kept = is_roof[(flat[:, 0] // block).astype(int), (flat[:, 1] // block).astype(int)]
    flat = flat[kept] + rng.normal(0, jitter * min(along, across), (np.count_nonzero(kept), 2))
    cos, sin = math.cos(turn), math.sin(turn)
    xy = flat @ np.array([[cos, sin], [-sin, cos]])
    return np.column_stack((xy, np.zeros(len(xy))))


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.3])
@pytest.mark.parametrize(("along", "across"), [(0.5, 0.5), (0.4, 1.0), (0.12, 0.9)])
@pytest.mark.parametrize("window", [2.2, 4.5])
def test_components_are_those_of_the_published_loop(along, across, turn, window):
    points = scanned_houses(along, across, turn, jitter=0.12, size=20.0 if along < 0.2 else 40.0)
    spacing = math.sqrt(along * across)
    chains = chain_along_scan(as_pulses(points, None, None), window, spacing)
    patterns = set(chains.patterns)
    assert all(one.is_isotropic == (along == across) for one in patterns if one)
    found = partition(chains.component)
    for pattern in patterns:
        # A component is what the loop finds with the window of its place.
        expected = partition(grown_as_published(points[:, :2], pattern, window))
        numbers = [k for k, one in enumerate(chains.patterns) if one == pattern]
        own = {frozenset(np.flatnonzero(chains.component == k)) for k in numbers}
        assert own <= expected
    assert len(found) == chains.n_components


@pytest.mark.parametrize("window", [2.0, 4.0])
@pytest.mark.parametrize("step", [0.25, 0.1])
def test_a_lattice_with_points_on_the_rim_of_the_window_is_chained_as_published(window, step):
    rng = np.random.default_rng(4)
    cells = rng.integers(0, 60, (1400, 2))
    points = np.column_stack((cells * step, np.zeros(len(cells))))
    half = window / 2.0 * SLACK * step
    found, _ = chain_windows(points, (half, half))
    expected = grown_as_published(points[:, :2], ScanPattern.isotropic(step), window)
    assert partition(found) == partition(expected)
    # Rounded steps of 0.1 m tear nothing that whole numbers hold together.
    exact = grown_as_published(cells.astype(float), ScanPattern.isotropic(1.0), window)
    assert partition(expected) == partition(exact)


def test_a_roof_sparser_than_what_lies_around_is_one():
    rows = np.random.default_rng(2).uniform((0.0, 0.0), (12.0, 10.0), (300, 2))
    rows[:, 1] = 0.8 * np.round(rows[:, 1] / 0.8)  # 2.5 points a square metre, in rows
    found = segment_buildings(np.column_stack((rows, np.full(300, 6.0))), point_spacing=0.3)
    assert len(found.patterns) == 1
    assert (found.building_id > 0).all()


def test_lines_far_apart_are_one_roof_where_a_square_window_tears_them():
    points = scanned_houses(0.05, 0.6, 0.4, jitter=0.1, size=12.0, share=2.0)
    spacing = math.sqrt(0.05 * 0.6)
    assert 2.25 * spacing < 0.6
    for config in (KEEP_ALL, AS_PUBLISHED):
        found = segment_buildings(points, config, point_spacing=spacing)
        assert len(np.unique(found.building_id)) == 1
        (pattern,) = found.patterns.values()
        assert (pattern.along, pattern.across) == pytest.approx((0.05, 0.6), rel=0.1)


def test_the_result_turns_with_the_points():
    points = scanned_houses(0.3, 1.2, 0.0, jitter=0.1, size=90.0, share=0.2)
    config = SegmentationConfig(min_points=1, min_area=0.0)
    found = partition(segment_buildings(points, config, point_spacing=0.6).building_id)
    assert len(found) > 3
    mirrored = segment_buildings(points * np.array([1.0, -1.0, 1.0]), config, point_spacing=0.6)
    assert partition(mirrored.building_id) == found
    for turn in (0.6, math.pi / 2, 2.0):
        cos, sin = math.cos(turn), math.sin(turn)
        turned = points @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        again = segment_buildings(turned, config, point_spacing=0.6)
        assert partition(again.building_id) == found
        for pattern in again.patterns.values():
            off = (pattern.direction - turn + math.pi / 2) % math.pi - math.pi / 2
            assert abs(math.degrees(off)) < 3.0


def test_a_pattern_is_that_of_its_place_whatever_else_is_in_the_tile():
    lines = scanned_houses(0.3, 1.0, 0.3, jitter=0.1, size=15.0, share=2.0)
    other = scanned_houses(0.3, 1.0, 1.7, jitter=0.1, size=15.0, share=2.0, seed=1) + np.array([60.0, 0, 0])
    alone = segment_buildings(lines, KEEP_ALL, point_spacing=0.55)
    both = segment_buildings(np.vstack((lines, other)), KEEP_ALL, point_spacing=0.55)
    assert np.array_equal(both.building_id[: len(lines)], alone.building_id)
    for number, pattern in alone.patterns.items():
        assert both.patterns[number] == pattern
    assert len({one.direction for one in both.patterns.values()}) == 2
