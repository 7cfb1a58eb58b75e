"""What rasters are made of: the TIN, distances between cells, closing, and the points of a cell."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage

from lidar_buildings.core.stages.terrain.cells import GROUND, LEFT_OUT, SEEN, Cells, closed, squared_distance
from lidar_buildings.core.stages.terrain.window import RasterWindow

MASKS = hnp.arrays(bool, st.tuples(st.integers(1, 14), st.integers(1, 14)), elements=st.booleans())


@settings(max_examples=60)
@given(marked=MASKS, reach=st.integers(0, 9))
def test_distances_are_euclidean_as_far_as_they_matter(marked, reach):
    found = squared_distance(marked, reach)
    far = (reach + 1) ** 2
    expected = np.full(marked.shape, far)
    if marked.any():
        expected = np.rint(ndimage.distance_transform_edt(~marked) ** 2).astype(int)
    np.testing.assert_array_equal(np.minimum(found, far), np.minimum(expected, far))


@settings(max_examples=40)
@given(marked=MASKS, reach=st.integers(0, 5))
def test_closing_leaves_open_just_where_an_empty_circle_fits(marked, reach):
    padded = np.pad(marked, reach + 1)
    steps = np.arange(-reach, reach + 1)
    disc = steps[:, None] ** 2 + steps**2 <= reach * reach
    wider = steps[:, None] ** 2 + steps**2 <= (reach + 0.5) ** 2
    room = ~ndimage.binary_dilation(np.pad(padded, reach), wider)
    covered = ndimage.binary_dilation(room, disc)[reach : -reach or None, reach : -reach or None]
    inner = np.s_[reach + 1 : -reach - 1, reach + 1 : -reach - 1]
    np.testing.assert_array_equal(closed(padded, reach)[inner], ~covered[inner])
    assert closed(padded, reach)[padded].all()


def test_each_cell_has_the_mean_and_the_ends_of_its_points():
    random = np.random.default_rng(6)
    points = random.uniform(0.0, 6.0, (400, 3))
    cells = Cells(RasterWindow(1.0, 0, -7, 8, 7), (0.0, 0.0))
    rows, columns = 6 - np.floor(points[:, 1]), np.floor(points[:, 0])
    kind, all_of = np.full(400, GROUND, dtype=np.uint8), np.ones(400, dtype=bool)
    contents = cells.contents(points, kind, all_of, all_of)
    for found, choose in (
        (contents.ground, lambda p: p.mean(axis=0)),
        (contents.first, lambda p: p[p[:, 2].argmax()]),
        (contents.lowest, lambda p: p[p[:, 2].argmin()]),
    ):
        assert found.mask((7, 8)).sum() == len(found.points) == 36
        for row, column, point in zip(found.rows, found.columns, found.points, strict=True):
            mine = points[(rows == row) & (columns == column)]
            np.testing.assert_allclose(point, choose(mine), atol=1e-5)


def test_of_points_as_high_the_same_one_is_taken_in_any_order():
    points = np.column_stack((np.random.default_rng(7).uniform(0, 1, (20, 2)), np.ones(20)))
    cell = Cells(RasterWindow(1.0, 0, -1, 1, 1), (0.0, 0.0))
    for order in (slice(None), slice(None, None, -1)):
        is_first = np.arange(20)[order] < 12
        kind = np.full(20, SEEN, dtype=np.uint8)
        contents = cell.contents(points[order], kind, np.ones(20, dtype=bool), is_first)
        for found, of in zip(contents[3:], (points[:12], points[12:], points), strict=True):
            assert found.points[0, 0] == of[:, 0].min()


def test_cells_tell_of_core_and_of_others_and_nothing_of_what_is_left_out():
    points = np.array([[0.5, 0.5, 1.0], [1.5, 0.5, 2.0], [1.6, 0.6, 9.0], [2.5, 0.5, 3.0], [9e9, 0.5, 0.0]])
    kind = np.array([GROUND, SEEN, LEFT_OUT, GROUND, LEFT_OUT], dtype=np.uint8)
    is_core = np.array([True, True, True, False, True])
    cells = Cells(RasterWindow(1.0, 0, -1, 3, 1), (0.0, 0.0))
    contents = cells.contents(points, kind, is_core, np.array([True, False, True, True, True]))
    assert contents.own.tolist() == [[True, True, False]]
    assert contents.others.tolist() == [[False, False, True]]
    assert contents.ground.columns.tolist() == contents.first.columns.tolist() == [0, 2]
    assert contents.later.points.tolist() == [points[1].tolist()]
    np.testing.assert_array_equal(contents.lowest.points, points[[0, 1, 3]])
