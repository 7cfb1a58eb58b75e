"""What terrain and roof scenes promise alike: they can be made again, and turned."""

from functools import partial

import numpy as np
import pytest

from bench.scenes.roofs import ROOF_SCENES
from bench.scenes.terrain import TERRAIN_SCENES

#: All scenes at a quarter of their own density.
SCENES = {
    f"{kind} {name}": partial(scene, density=scene.__kwdefaults__["density"] / 4)
    for kind, scenes in (("terrain", TERRAIN_SCENES), ("roofs", ROOF_SCENES))
    for name, scene in scenes.items()
}


def columns_of(scene):
    """Coordinates along z and what else is known of the points, the truth included."""
    known = dict(zip(scene._fields, scene, strict=True))
    points, columns = known.pop("points"), known.pop("columns", {})
    return {"z": points[:, 2], **columns, **known}


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_the_same_again_another_with_another_seed_and_can_be_turned(name):
    plain, again, other = SCENES[name](), SCENES[name](), SCENES[name](seed=1)
    np.testing.assert_array_equal(plain.points, again.points)
    np.testing.assert_equal(columns_of(plain), columns_of(again))
    assert not np.array_equal(plain.points[:500], other.points[:500])
    turned = SCENES[name](rotation_deg=30.0)
    np.testing.assert_equal(columns_of(plain), columns_of(turned))
    rows = np.arange(0, len(plain.points), 97)
    edges = [scene.points[rows, :2] - scene.points[rows[0], :2] for scene in (plain, turned)]
    np.testing.assert_allclose(*(np.hypot(*edge.T) for edge in edges), atol=1e-9)
    bearings = np.rad2deg([np.arctan2(*edge[1:, ::-1].T) for edge in edges])
    np.testing.assert_allclose((bearings[1] - bearings[0]) % 360, 30.0, atol=1e-6)
