"""What has changed between two surveys whose every change is known."""

import json

import numpy as np
import pyogrio.raw
import pytest
import shapely
from support.score_files import ORIGIN, write_cloud

from lidar_buildings.cli import main
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.evaluation.changes import ChangeConfig, compare_runs
from lidar_buildings.io.vectors.layers import VectorLayer, geopackage_file

#: Point spacing and noise of both surveys [m].
SPACING, NOISE = 0.3, 0.03
HOUSE = shapely.box(10.0, 10.0, 24.0, 20.0)


def gable(x, y):
    return 5.0 + 0.8 * (5.0 - np.abs(y - 15.0))


def flat(z):
    return lambda x, y: np.full(len(x), z)


def survey(folder, roofs, *, seed=0, others=(), hidden=(), shift=(0.0, 0.0, 0.0), crs="EPSG:28992", **sigmas):
    """
    Write what a run writes: a lawn of 50 by 40 m with roofs, (polygon, elevation) each, that `others`, with
    a class, cover; without points where it is hidden.
    """
    random = np.random.default_rng(seed)
    x, y = (one.ravel() for one in np.meshgrid(np.arange(0.0, 50.0, SPACING), np.arange(0.0, 40.0, SPACING)))
    x, y = (one + random.uniform(-0.1, 0.1, len(one)) for one in (x, y))
    z, classes = np.zeros(len(x)), np.full(len(x), PointClass.GROUND)
    for polygon, elevation, code in [*((*roof, PointClass.BUILDING) for roof in roofs), *others]:
        rows = shapely.intersects_xy(polygon, x, y)
        z[rows], classes[rows] = elevation(x[rows], y[rows]), code
    points = np.column_stack([x, y, z + random.normal(0.0, NOISE, len(x))]) + shift
    kept = ~np.any([shapely.intersects_xy(one, x, y) for one in hidden] or [np.zeros(len(x), bool)], axis=0)
    write_cloud(folder / "classified" / "tile.laz", points[kept], classes[kept])
    known = {"point_spacing": SPACING, "outline_sigma": 0.1, "plane_sigma": NOISE, "corner_sigma_z": 0.02}
    known |= {"n_points": 800, "n_planes": 2} | sigmas
    fields = {"building_id": int} | {name: type(value) for name, value in known.items()}
    rows = [{"building_id": 100 + k, **known} for k in range(len(roofs))]
    outlines = shapely.transform([one for one, _ in roofs], lambda xy: xy + ORIGIN[:2] + shift[:2])
    with geopackage_file(folder / "buildings.gpkg", crs) as add:
        add(VectorLayer("outlines", list(outlines), fields, rows))
    return folder


def changes(tmp_path, old, new, **of_new):
    found = compare_runs(
        survey(tmp_path / "old", old), survey(tmp_path / "new", new, seed=1, **of_new), ChangeConfig()
    )
    return found, [(one.change, one.old, one.new) for one in found.changes]


def test_a_second_flight_over_the_same_houses_finds_no_change(tmp_path):
    houses = [(HOUSE, gable), (shapely.box(30.0, 10.0, 40.0, 18.0), flat(4.0))]
    found, told = changes(tmp_path, houses, houses, shift=(0.15, -0.1, 0.4))
    assert told == []
    assert found.words == (["unchanged"] * 2, ["unchanged"] * 2)
    assert found.offset == pytest.approx(0.4, abs=0.02)
    assert found.scatter < 0.1


def test_a_house_that_was_built_and_one_that_is_gone_are_told(tmp_path):
    other = shapely.box(30.0, 22.0, 40.0, 30.0)
    found, told = changes(tmp_path, [(HOUSE, gable)], [(other, flat(6.0))])
    assert told == [("new", -1, 0), ("gone", 0, -1)]
    built, gone = found.changes
    assert built.height == pytest.approx(6.0, abs=0.05)
    assert built.area == pytest.approx(80.0)
    assert gone.height == pytest.approx(-7.0, abs=0.1)
    assert found.words == (["gone"], ["new"])


@pytest.mark.parametrize(("by", "word"), [(3.0, "raised"), (-2.0, "lowered")])
def test_a_roof_that_is_higher_or_lower_as_a_whole_is_told_by_how_much(tmp_path, by, word):
    found, told = changes(
        tmp_path, [(HOUSE, gable)], [(HOUSE, lambda x, y: gable(x, y) + by)], shift=(0.1, 0.1, 0.0)
    )
    assert told == [(word, 0, 0)]
    assert found.changes[0].height == pytest.approx(by, abs=0.1)
    assert found.changes[0].sigma < 0.05


@pytest.mark.parametrize(("by", "word"), [(0.8, "raised"), (0.0, "unchanged")])
def test_a_shift_in_plan_neither_hides_a_change_of_a_steep_roof_nor_is_one(tmp_path, by, word):
    places = [
        shapely.box(x, y, x + 14.0, y + 10.0)
        for x, y in ((2, 2), (18, 2), (34, 2), (2, 16), (18, 16), (34, 16))
    ]

    def roof(box, rise):
        (x, y), along_x = box.centroid.coords[0], box.bounds[1] < 10.0
        return box, lambda px, py: 8.0 + rise - 0.9 * np.abs(py - y if along_x else px - x)

    old = [roof(box, 0.0) for box in places]
    new = [roof(places[0], by), *old[1:]]
    found, _ = changes(tmp_path, old, new, shift=(0.4, -0.3, 0.0), outline_sigma=0.3)
    assert found.words[1] == [word, *["unchanged"] * 5]
    assert [one.height for one in found.changes] == pytest.approx([by] * bool(by), abs=0.1)


@pytest.mark.parametrize(
    ("sigmas", "word"),
    [
        pytest.param({"plane_sigma": 3.0}, "unchanged", id="planes through points of anything"),
        pytest.param({"corner_sigma_z": 0.4}, "raised", id="eaves where walls are not sure"),
    ],
)
def test_a_change_of_height_is_none_if_the_planes_are_not_sure(tmp_path, sigmas, word):
    raised = [(HOUSE, lambda x, y: gable(x, y) + 1.0)]
    found, _ = changes(tmp_path, [(HOUSE, gable)], raised, **sigmas)
    assert found.words == ([word], [word])


def test_a_dormer_is_a_change_of_a_part_of_the_roof(tmp_path):
    dormer = shapely.box(14.0, 11.0, 18.0, 14.0)
    found, told = changes(tmp_path, [(HOUSE, gable)], [(HOUSE, gable), (dormer, flat(8.4))])
    assert told[0] == ("roof changed", 0, 0)
    one = found.changes[0]
    near = shapely.transform(dormer.buffer(0.8), lambda xy: xy + ORIGIN[:2])
    assert one.place.intersection(near).area == pytest.approx(one.area)
    assert one.area >= 0.6 * dormer.area


def test_an_annex_extends_a_house_and_its_end_reduces_it(tmp_path):
    annex = shapely.box(24.0, 10.0, 30.0, 16.0)
    larger = HOUSE.union(annex)
    here = [(HOUSE, gable)]
    there = [(larger, lambda x, y: np.where(x > 24.0, 3.0, gable(x, y)))]
    found, told = changes(tmp_path, here, there)
    assert told == [("extended", 0, 0)]
    assert found.changes[0].area == pytest.approx(annex.area, rel=0.25)
    found, told = changes(tmp_path / "back", there, here)
    assert told == [("reduced", 0, -1)]
    assert found.words == (["reduced"], ["unchanged"])


def test_what_is_only_classified_otherwise_or_stands_beside_is_no_change(tmp_path):
    tree, wire = shapely.box(24.5, 10.0, 28.0, 14.0), shapely.box(12.0, 9.0, 12.4, 21.0)
    as_tree = [(HOUSE, gable, PointClass.HIGH_VEGETATION)]
    found, told = changes(
        tmp_path, [(HOUSE, gable)], [(HOUSE, gable)],
        others=[(tree, flat(6.0), PointClass.HIGH_VEGETATION), (wire, flat(12.0), PointClass.BUILDING)],
    )  # fmt: skip
    assert told == []
    found, told = changes(tmp_path / "tree", [(HOUSE, gable)], [], others=as_tree)
    assert (told, found.words) == ([], (["unchanged"], []))


def test_what_one_survey_has_not_seen_is_not_told(tmp_path):
    found, told = changes(tmp_path, [(HOUSE, gable)], [], hidden=[HOUSE.buffer(3.0)])
    assert (told, found.words) == ([], (["not seen"], []))


def test_limits_decide_what_counts(tmp_path):
    here = survey(tmp_path / "old", [(HOUSE, gable)])
    there = survey(tmp_path / "new", [(HOUSE, lambda x, y: gable(x, y) + 1.0)])
    assert compare_runs(here, there, ChangeConfig(min_height=1.5)).changes == []
    assert len(compare_runs(here, there).changes) == 1
    for name in ("min_height", "min_area", "min_storey"):
        with pytest.raises(ParameterError, match=name):
            ChangeConfig(**{name: 0.0})


def test_surveys_without_buildings_have_no_changes(tmp_path):
    found, told = changes(tmp_path, [], [])
    assert (told, found.words) == ([], ([], []))


def test_the_command_writes_the_changes_and_both_sides_with_theirs(tmp_path, capsys):
    other = shapely.box(30.0, 22.0, 40.0, 30.0)
    old = survey(tmp_path / "old", [(HOUSE, gable)])
    new = survey(tmp_path / "new", [(HOUSE, gable), (other, flat(6.0))], seed=1)
    assert main(["compare", str(old), str(new)]) == 0
    text = capsys.readouterr().out
    assert all(words in text for words in ("1 new", "1 unchanged", "new 101"))
    path = new / "changes.gpkg"
    layers = {name: pyogrio.raw.read(path, layer=name) for name in ("changes", "old", "new")}
    words = {
        name: columns[list(about["fields"]).index("change")].tolist()
        for name, (about, _, _, columns) in layers.items()
    }
    assert words == {"changes": ["new"], "old": ["unchanged"], "new": ["unchanged", "new"]}
    place, outline = (
        shapely.from_wkb(layers["changes"][2][0]),
        shapely.transform(other, lambda xy: xy + ORIGIN[:2]),
    )
    assert shapely.symmetric_difference(place, outline).area < 1e-3
    assert main(["compare", str(old), str(new), "--json", "--output", str(tmp_path / "c.gpkg")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["buildings"] == {"new": 1, "unchanged": 1}
    assert (told["changes"][0]["old_id"], told["changes"][0]["new_id"]) == (None, 101)
    assert (tmp_path / "c.gpkg").is_file()


def test_what_cannot_be_compared_is_refused_naming_what_and_why(tmp_path, capsys):
    here = survey(tmp_path / "old", [(HOUSE, gable)])
    elsewhere = survey(tmp_path / "new", [(HOUSE, gable)], crs="EPSG:25832")
    with pytest.raises(InputError, match=r"EPSG:28992.*EPSG:25832.*give results in the same one"):
        compare_runs(here, elsewhere)
    assert main(["compare", str(here), str(tmp_path / "nothing")]) == 2
    assert "nothing: no such file or folder" in capsys.readouterr().err
