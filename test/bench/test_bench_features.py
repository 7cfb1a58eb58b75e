"""The benchmark of features, on points few enough for a test; nothing here looks at how fast anything was."""

import numpy as np
import pytest
from support.lawn import write_las

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
