"""The ground about a building, told by places under its roof."""

import numpy as np
import pytest

from lidar_buildings.core.surfaces.known_ground import KnownGround


def under_roof(elevation, seed=0):
    xy = np.random.default_rng(seed).uniform(0, 15, (900, 2))
    return np.column_stack([xy, elevation(xy)])


def plane(xy):
    return 80.0 + 0.3 * xy[:, 0] - 0.1 * xy[:, 1]


ABOUT = np.array([[-0.5, -0.5], [7.0, 15.4], [15.5, 3.0], [7.0, 7.0], [30.0, -10.0]])


def test_a_plane_goes_on_beyond_the_places():
    assert KnownGround.at(under_roof(plane)).elevation(ABOUT) == pytest.approx(plane(ABOUT), abs=1e-6)


def test_a_bend_goes_on_a_little_beyond_the_places():
    def bend(xy):
        return plane(xy) + 0.01 * (xy[:, 0] - 7.0) ** 2

    near = ABOUT[:4]
    assert KnownGround.at(under_roof(bend)).elevation(near) == pytest.approx(bend(near), abs=0.07)


def test_bases_of_walls_that_pass_for_ground_are_left_out():
    def raised(xy):
        return plane(xy) + 0.8 * np.maximum(1.0 - np.hypot(xy[:, 0], xy[:, 1] - 7.0) / 2.0, 0.0)

    foot = np.column_stack([np.full(16, -0.2), np.arange(16.0)])
    assert KnownGround.at(under_roof(raised)).elevation(foot) == pytest.approx(plane(foot), abs=0.1)


@pytest.mark.parametrize("n_places", [1, 2, 3])
def test_few_places_on_a_line_are_enough(n_places):
    places = np.column_stack([np.arange(n_places), np.zeros(n_places), np.full(n_places, 5.0)])
    assert KnownGround.at(places).elevation(ABOUT) == pytest.approx(np.full(5, 5.0))


def test_what_lies_far_does_not_matter():
    def rough(xy):
        return plane(xy) + 0.2 * np.sin(xy[:, 0]) * np.cos(xy[:, 1])

    whole = KnownGround.at(under_roof(rough))
    part = whole.within(np.array([-12.0, -12.0]), np.array([12.0, 12.0]))
    assert len(part.places) < len(whole.places)
    corner = np.array([[0.0, 0.0], [-0.3, 1.0]])
    assert np.array_equal(part.elevation(corner), whole.elevation(corner))


def test_nowhere_known_ground_is_refused():
    with pytest.raises(ValueError, match="places is empty"):
        KnownGround.at(np.empty((0, 3)))
