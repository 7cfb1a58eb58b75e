"""The benchmark of edge labels, on houses small enough for a test."""

import numpy as np
import pytest
import shapely
from support.cli_runs import lines_of
from support.lawn import DENSITY, HOUSES, houses_on_a_lawn, write_las
from support.score_files import write_polygons

from bench.common import areas as roof_areas
from bench.edges import run as edges
from bench.edges import truth as edge_outlines
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A data folder with all four areas; Toronto's points have no classes."""
    folder = tmp_path_factory.mktemp("data")
    points, roof = houses_on_a_lawn()
    for name in ("delft", "montpellier", "fusa"):
        write_las(folder / name / "a.laz", points, np.where(roof, 6, 2))
    write_las(folder / "toronto" / "a.laz", points, np.ones(len(points)))
    # The map has the first house only.
    write_polygons(folder / "delft" / "blocks_nw.gpkg", [shapely.box(*HOUSES[0])])
    return folder


def test_areas_are_roofs_of_a_map_of_classes_and_of_this_package(data):
    areas = roof_areas.areas_in(data)
    _, roof = houses_on_a_lawn()
    assert {name: int(area.roof.max()) + 1 for name, area in areas.items()} == {
        "delft": 1,
        "montpellier": 2,
        "fusa": 2,
        "toronto": 2,
    }
    assert len(areas["fusa"].points) == roof.sum()
    assert len(areas["delft"].points) + areas["delft"].n_left_out == roof.sum()
    assert len(areas["toronto"].points) == pytest.approx(roof.sum(), rel=0.05)
    assert areas["fusa"].spacing == pytest.approx(DENSITY**-0.5, rel=0.1)


def test_every_method_is_scored_in_every_area_as_published_and_by_default(data, tmp_path, capsys):
    edges.main(["--data", str(data), "--plot", str(tmp_path / "scores.png")])
    assert (tmp_path / "scores.png").read_bytes().startswith(b"\x89PNG")
    output = capsys.readouterr().out
    sizes = output.split("Published:")[0]
    assert [words[1] for name in ("delft", "fusa") for words in lines_of(sizes, name)] == ["1", "2"]
    published, default = output.split("Published:")[1].split("Default:")
    for text in (published, default):
        for method in edges.METHODS:
            rows = lines_of(text, method)
            assert [words[1] for words in rows] == ["delft", "montpellier", "fusa", "toronto", "mean"]
            figures = np.array([[float(word) for word in words[2:]] for words in rows])
            assert ((figures >= 0) & (figures <= 100)).all()
            np.testing.assert_allclose(figures[4], figures[:4].mean(axis=0), atol=0.011)
    assert float(lines_of(default, "k_means_linearity")[-1][4]) > 90, "on two plain houses"
    assert not lines_of(published, edges.CONTROL)
    assert len(lines_of(default, edges.CONTROL)) == 5
    assert "61 to 98 %" in output


def test_parameters_are_used_and_what_the_methods_choose_is_refused():
    configs = edges.configs_of("default", ["k_means_linearity"], {"rim_radius": 2.0})
    assert configs["k_means_linearity"] == EdgeLabellingConfig(features="linearity", rim_radius=2.0)
    assert edges.CONTROL not in edges.configs_of("default", ["k_means_linearity"], {"thinning": "none"})
    with pytest.raises(SystemExit, match="--set features: is what --methods chooses"):
        edges.main(["--set", "features=linearity"])
    with pytest.raises(SystemExit, match="there is no parameter"):
        edges.main(["--set", "colour=red"])


def test_labels_are_compared_with_exact_outlines_too(capsys):
    arguments = ["--scenes", "single_house", "--density", "6", "--methods", "k_means_linearity"]
    edge_outlines.main(arguments)
    published, default = capsys.readouterr().out.split("Default:")
    scores = [lines_of(text, "k_means_linearity")[0] for text in (published, default)]
    assert [words[1:3] for words in scores] == [["single_house", "6"]] * 2
    assert float(scores[1][4]) > float(scores[0][4])
    assert float(scores[1][5]) > 85
