"""What a view draws of a result: faces and borders of models, points by colour; the camera sees all of it."""

import sys
from unittest.mock import MagicMock

import numpy as np
import pytest
from support.model_survey import DUTCH, EAVE, FEET, GROUND, RIDGE
from support.result_folders import DENSITY, with_points, written_models

from lidar_buildings.cli import main
from lidar_buildings.report.contents import UNKNOWN, Relief, contents_of
from lidar_buildings.report.result_folder import read_result
from lidar_buildings.report.view import ABOVE, NOTHING, OF_POINTS, SIDES, drawing, parts
from lidar_buildings.report.view.drawing import camera_of


@pytest.fixture(scope="module", params=[DUTCH, FEET], ids=["metres", "feet"])
def contents(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("view") / "out"
    return contents_of(read_result(with_points(written_models(folder, request.param), request.param)))


def drawn(contents, roofs=NOTHING, points=NOTHING):
    """What is drawn, by number of corners: 3 of triangles, 2 of lines, 1 of points."""
    return {part.places.shape[1]: part for part in reversed(parts.parts_of(contents, roofs, points))}


def within(places, west, south, east, north):
    """Rows that lie within a rectangle, its sides included."""
    xy = places[..., :2].reshape(len(places), -1, 2)
    return ((xy > np.array([west, south]) - 0.2) & (xy < np.array([east, north]) + 0.2)).all(axis=(1, 2))


def test_the_finest_solid_is_drawn_with_one_line_where_faces_meet(contents):
    shown = drawn(contents, roofs="type")
    corners = shown[3].places[within(shown[3].places, 0, 0, 10, 8)]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    roof, walls, foot = (
        2 * 10 * 5.0,
        2 * 8 * (EAVE - GROUND) + 2 * 10 * (EAVE - GROUND) + 8 * (RIDGE - EAVE),
        80.0,
    )
    assert np.linalg.norm(across, axis=1).sum() / 2 == pytest.approx(roof + walls + foot, rel=1e-3)
    # gables are two walls each: round the foot and up the walls six each, two eaves, four verges, one ridge
    assert within(shown[2].places, 0, 0, 10, 8).sum() == 19
    assert within(shown[2].places, 0, 20, 20, 40).sum() == 24


def test_roofs_are_coloured_by_their_slope_and_brighter_towards_the_light(contents):
    shown = drawn(contents, roofs="slope")[3]
    normals = np.cross(shown.places[:, 1] - shown.places[:, 0], shown.places[:, 2] - shown.places[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    is_roof = within(shown.places, 0, 0, 10, 8) & (normals[:, 2] > 0.1)
    south, north = (shown.colours[is_roof & (sign * normals[:, 1] > 0)][0] for sign in (-1, 1))
    assert south.sum() > north.sum()
    np.testing.assert_allclose(south / south.sum(), north / north.sum())
    level = shown.colours[within(shown.places, 0, 20, 20, 40) & (normals[:, 2] > 0.9)][0]
    np.testing.assert_allclose(level / level.max(), parts.SLOPES[0] / parts.SLOPES[0].max())
    assert np.abs(south / south.max() - level / level.max()).max() > 0.1


@pytest.mark.parametrize("by", OF_POINTS)
def test_points_lie_where_they_are_in_a_colour_each(contents, by):
    shown = drawn(contents, points=by)[1]
    z = shown.places[:, 0, 2]
    assert len(shown.colours) == len(z) > 1000
    assert z.min() == pytest.approx(GROUND, abs=0.01)
    assert ((shown.colours >= 0) & (shown.colours <= 1)).all()
    is_lawn = z < GROUND + 0.01
    of_lawn = np.unique(shown.colours[is_lawn], axis=0)
    expected = {"class": parts.CLASSES[2], "height": parts.HEIGHTS[0], "intensity": parts.GREYS[0]}
    np.testing.assert_allclose(of_lawn, [expected.get(by, parts.NONE)], atol=0.01)
    n_house = round(10 * 8 * DENSITY) + round(DENSITY)
    is_house = (shown.colours != parts.NONE).any(axis=1)
    if by == "building":
        assert len(np.unique(shown.colours[is_house], axis=0)) == 1
        assert is_house.sum() == n_house
    if by == "plane":
        assert len(np.unique(shown.colours[is_house], axis=0)) == 2
        assert is_house.sum() == n_house - round(DENSITY)


def test_outlines_lie_at_the_foot_of_buildings_or_at_the_foot_of_all(contents):
    z = drawn(contents)[2].places[..., 2]
    assert z.max() - z.min() < 1e-6
    assert z.min() == pytest.approx(GROUND, abs=0.1)


def test_terrain_has_no_triangles_at_unknown_cells(contents):
    steps = np.zeros((4, 5), dtype=np.int16)
    steps[0, 0] = UNKNOWN
    part = parts._terrain(Relief(steps, 2.0, 0.01, 100.0, 50.0, (2.0, 1.0)))
    # two triangles between each four cells, one of which has the unknown one for a corner
    assert len(part.places) == 2 * 3 * 4 - 1
    assert part.places[..., 2].min() == part.places[..., 2].max() == 2.0
    np.testing.assert_allclose(part.places.reshape(-1, 3)[:, :2].min(axis=0), [101.0, 46.5])


@pytest.mark.parametrize("size", [(1600, 1000), (300, 700)])
@pytest.mark.parametrize("eye", [*SIDES, ABOVE])
def test_the_camera_sees_all_places_and_no_more_than_it_must(eye, size):
    places = np.random.default_rng(0).uniform((0, 0, 0), (300.0, 120.0, 40.0), (500, 3)) + 1000.0
    focal, extrinsic = camera_of(places, eye, size)
    right, down, ahead = (np.column_stack([places, np.ones(len(places))]) @ extrinsic.T)[:, :3].T
    assert ahead.min() > 0
    shares = np.abs([right / ahead * focal / size[0] * 2, down / ahead * focal / size[1] * 2]).max(axis=1)
    assert shares.max() == pytest.approx(0.98)
    eye_is_at = np.linalg.inv(extrinsic)[:3, 3] - places.mean(axis=0)
    assert ("north" in eye) <= (eye_is_at[1] > 0)
    assert ("west" in eye) <= (eye_is_at[0] < 0)
    assert eye_is_at[2] > 0


def test_a_picture_from_above_has_the_roof_in_the_middle_and_paper_around(contents):
    pytest.importorskip("open3d", exc_type=ImportError)
    square = np.array(
        [[[0, 0, 0], [10, 0, 0], [10, 10, 0]], [[0, 0, 0], [10, 10, 0], [0, 10, 0]]], dtype=float
    )
    picture = drawing.picture_of([parts.Coloured(square, np.tile((1.0, 0.0, 0.0), (2, 1)))], ABOVE, (120, 60))
    assert picture.shape == (60, 120, 3)
    np.testing.assert_array_equal(picture[30, 60], (255, 0, 0))
    np.testing.assert_array_equal(picture[30, 10], (255, 255, 255))


@pytest.fixture
def result(tmp_path):
    return str(written_models(tmp_path / "out", DUTCH))


def test_without_open3d_one_line_says_what_to_install(result, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "open3d", None)
    assert main(["view", result, "--picture", result + "/view.png"]) == 2
    assert (
        capsys.readouterr().err
        == "lidar-buildings: view: needs Open3D: pip install '.[view]' in the sources\n"
    )


def test_a_missing_library_is_named_with_what_to_install(result, tmp_path, monkeypatch, capsys):
    (tmp_path / "open3d.py").write_text(
        "raise ImportError('libusb-1.0.so.0: cannot open shared object file')"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    assert main(["view", result, "--picture", result + "/view.png"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "(libusb-1.0.so.0: cannot open shared object file): install" in line


@pytest.mark.parametrize(
    ("options", "told"), [((), "use --picture FILE"), (("--picture", "view.png"), "without OpenGL")]
)
def test_where_nothing_can_be_drawn_one_line_says_so(result, options, told, monkeypatch, capsys):
    library = MagicMock()
    library.visualization.Visualizer().create_window.return_value = False
    monkeypatch.setitem(sys.modules, "open3d", library)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", result, *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


def test_keys_of_the_window_show_the_next_colours(monkeypatch):
    library = MagicMock()
    window = library.visualization.VisualizerWithKeyCallback()
    monkeypatch.setitem(sys.modules, "open3d", library)
    monkeypatch.setenv("DISPLAY", ":0")
    asked = []

    def parts_of(*shown):
        asked.append(shown)
        return [parts.Coloured(np.zeros((1, 1, 3)), np.ones((1, 3)))]

    drawing.open_window(parts_of, ("slope", "edge"), ABOVE)
    keys = {chr(call.args[0]): call.args[1] for call in window.register_key_callback.call_args_list}
    for key in "MMG":
        keys[key](window)
    assert asked == [("slope", "edge"), (NOTHING, "edge"), ("type", "edge"), ("type", NOTHING)]
    window.run.assert_called_once()
    window.destroy_window.assert_called_once()


def test_a_picture_of_another_kind_is_refused(result, capsys):
    assert main(["view", result, "--picture", "view.doc"]) == 2
    assert "must end with .png" in capsys.readouterr().err


def test_a_result_with_nothing_to_draw_is_told(result, tmp_path, capsys):
    for path in (tmp_path / "out").glob("*.gpkg"):
        path.unlink()
    assert main(["view", result, "--roofs", "none", "--picture", "view.png"]) == 2
    assert "contains nothing to draw" in capsys.readouterr().err
