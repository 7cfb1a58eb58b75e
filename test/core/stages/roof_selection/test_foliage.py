"""Flat spots of foliage are told from roofs by what pulses do there."""

import numpy as np

from lidar_buildings.core.neighbours.columns import by_column
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.smooth_patches.foliage import Patches, is_foliage

AREA = 20.0


def patch(z=2.5):
    x, y = np.meshgrid(np.arange(0.0, 5.0, 0.25), np.arange(0.0, 4.0, 0.25))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])


def foliage(points, is_only, label, area):
    """Return what is foliage of patches smaller than 40 m², height being z; points without one have −1."""
    columns = by_column(points, 0.375)
    is_last = np.ones(len(points), dtype=bool)
    only, label = is_only[columns.rows], label[columns.rows]
    candidates = Candidates(columns, columns.points[:, 2], is_last, only, np.zeros((0, 3)), 0.75, 0.5)
    smooth = columns.select(label >= 0)
    patches = Patches(smooth, label[smooth.rows], np.array(area))
    return is_foliage(candidates, patches, 40.0)


def judged(top, others, is_only=None, area=AREA):
    points = np.vstack([top, others])
    only = np.ones(len(points), dtype=bool) if is_only is None else is_only
    return bool(foliage(points, only, np.repeat([0, -1], [len(top), len(others)]), [area])[0])


def flanks(n, top, drop=(0.4, 1.2)):
    """Return loose points below the rim of a patch."""
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(0.0, 5.0, n), random.choice([-0.3, 4.0], n), np.zeros(n)])
    points[:, 2] = top[0, 2] - random.uniform(*drop, n)
    return points


def test_an_opaque_patch_with_clear_sides_is_no_foliage():
    assert not judged(patch(), flanks(20, patch()))


def test_a_patch_where_most_pulses_are_split_is_foliage_at_any_height():
    top = patch(z=9.0)
    others = flanks(20, top)
    split = np.arange(len(top) + len(others)) % 4 == 0
    assert judged(top, others, is_only=split)
    assert not judged(top, others, is_only=~split)


def test_a_large_one_is_a_roof_whatever_its_pulses_do():
    top, others = patch(), flanks(20, patch())
    assert not judged(top, others, is_only=np.zeros(len(top) + len(others), dtype=bool), area=60.0)
