"""The benchmark of features, on points few enough for a test; nothing here looks at how fast anything was."""

import numpy as np
import pytest
from support.lawn import write_las

from bench.common.tables import table
from bench.edges import feature_agreement, feature_peers, features
from bench.edges.feature_peers import CHOSEN, FIXED, LABELS, OWN


@pytest.fixture(scope="module")
def task():
    """A gable roof of 10 × 8 m, a wall below it, and one point alone."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 10, 1500), rng.uniform(0, 8, 1500)
    roof = np.column_stack([x, y, 9.0 - 0.6 * np.abs(y - 4.0) + rng.normal(0, 0.02, 1500)])
    wall = np.column_stack([rng.uniform(0, 10, 200), rng.normal(0, 0.02, 200), rng.uniform(0, 6, 200)])
    return feature_peers.task_of(np.vstack([roof, wall, [[50.0, 50.0, 0.0]]]), [0.75, 1.0, 1.5])


def lines_of(text, first):
    """The lines that begin with a name."""
    return [line for line in text.splitlines() if line.startswith(f"{first}  ")]


def needs(library):
    if not library.installed:
        pytest.skip(f"{library.package} is not installed")


def test_points_are_those_of_delft_s_class_6_or_simulated_roofs(tmp_path):
    name, points = features.roof_points(tmp_path, 0.5)
    assert name.startswith("simulated")
    assert len(points) > 500
    points = np.random.default_rng(0).uniform(0, 20, (300, 3))
    write_las(tmp_path / "delft" / "one.laz", points, np.repeat([2, 6, 1], 100))
    name, points = features.roof_points(tmp_path)
    assert name.startswith("Delft")
    assert len(points) == 100


@pytest.mark.parametrize("libraries", [FIXED, CHOSEN, LABELS], ids=["fixed", "chosen", "labels"])
def test_every_library_that_is_installed_is_timed(libraries, task):
    timings = features.time_all(libraries, task, repeats=2)
    assert OWN in timings
    for name, library in libraries.items():
        assert (name in timings) == library.installed
        for one in timings.get(name, []):
            assert one.features > 0
            assert one.total == one.search + one.features


@pytest.mark.parametrize("name", [name for name in FIXED if name not in (OWN, "pgeof")])
def test_features_of_the_same_definition_agree_to_1e_5(name, task):
    needs(FIXED[name])
    found = feature_agreement.differences(name, task)
    assert {one.library for one in found} == {name}
    for one in found:
        assert one.n_points > 1000, one.feature
        assert one.largest < 1e-5, one.feature


def test_a_difference_that_is_there_is_seen(task, monkeypatch):
    needs(FIXED["pgeof selected"])
    genuine = feature_agreement.pgeof_selected
    monkeypatch.setattr(
        feature_agreement,
        "pgeof_selected",
        lambda task: {name: column + 1e-3 for name, column in genuine(task).items()},
    )
    found = feature_agreement.differences("pgeof selected", task)
    assert [one.largest for one in found] == pytest.approx([1e-3] * len(found), rel=1e-6)


def test_pgeof_is_given_the_neighbours_of_the_same_sphere(task):
    needs(FIXED["pgeof"])
    _, neighbours, begins = feature_peers.pgeof_neighbours(task)
    own = feature_peers.own_features(task._replace(radii=task.radii[-1:]))
    assert np.mean(np.diff(begins) == own.n_neighbours) > 0.99
    assert neighbours[begins[-2]] == len(task.points) - 1


def test_peers_that_are_absent_are_left_out_and_named(monkeypatch, tmp_path, capsys):
    genuine = feature_peers.importlib.util.find_spec
    monkeypatch.setattr(
        feature_peers.importlib.util,
        "find_spec",
        lambda package: genuine(package) if package == OWN else None,
    )
    features.main(["--data", str(tmp_path), "--density", "0.5", "--repeats", "1"])
    output = capsys.readouterr().out
    assert len(lines_of(output, OWN)) == 3
    assert len(lines_of(output, "label_edges")) == 1
    for name in ("jakteristics", "pgeof selected", "pgeof", "open3d", "pgeof optimal"):
        assert [line.split()[-2:] for line in lines_of(output, name)] == [["not", "installed"]]


def test_ratios_are_of_the_best_runs():
    library = FIXED[OWN]
    searching = library._replace(search=lambda task: None)
    timings = {
        OWN: [features.Timing(0.0, 2.0), features.Timing(0.0, 1.0)],
        "other": [features.Timing(2.0, 2.0), features.Timing(3.0, 4.0)],
    }
    rows = features.speed_rows({OWN: library, "other": searching}, timings, 3_000_000)
    words = [line.split() for line in table(features.SPEED_HEADINGS, rows).splitlines()[2:]]
    assert words[0][1:] == ["1.000", "1.000–2.000", "–", "3.000", "1.0"]
    assert words[1][1:] == ["4.000", "4.000–7.000", "2.000", "0.750", "4.0"]


def test_copies_lie_side_by_side_and_do_not_see_one_another(task):
    both = features.side_by_side(task.points, 2)
    n = len(task.points)
    assert len(both) == 2 * n
    assert both[n:, 0].min() > both[:n, 0].max() + 50
    labels = feature_peers.own_edges(task._replace(points=both), True)
    assert np.array_equal(labels[:n], labels[n:])
    assert 0 < labels.sum() < n
