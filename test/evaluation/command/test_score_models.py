"""
``lidar-buildings score models``: against the truth of a simulation, another program's file, and a cloud.
"""

import json

import numpy as np
import pytest
from support.score_files import write_cloud
from support.source_tree import ROOT

from lidar_buildings.cli import main
from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.evaluation.command.score import run_score
from lidar_buildings.evaluation.readers.city_model import read_city_model
from lidar_buildings.simulation import make_scene
from lidar_buildings.simulation.survey import write_truth_city_model


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """The truth of a survey, and points on its roofs: 0.05 m too high."""
    folder = tmp_path_factory.mktemp("survey")
    scene = make_scene("roof_types")
    write_truth_city_model(folder / "truth.city.jsonl", scene)
    random = np.random.default_rng(0)
    xy = random.uniform(0, scene.size, (20_000, 2))
    points = [
        np.column_stack([xy[plane > 0], elevation[plane > 0] + 0.05])
        for plane, elevation in (building.roof_at(xy) for building in scene.buildings)
    ]
    write_cloud(folder / "points" / "roofs.laz", np.concatenate(points), 6, origin=scene.frame.origin)
    return folder


def test_the_truth_scores_full_marks_against_itself(survey, capsys):
    assert main(["score", "models", str(survey), str(survey), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["n_matched"], figures["lod_22_share"], figures["valid_share"]) == (14, 1.0, 1.0)
    assert (figures["roof_corner_f1"], figures["roof_edge_f1"], figures["ridge_recall"]) == (1.0, 1.0, 1.0)
    assert (figures["height_rmse"], figures["volume_ratio"], figures["same_roof_type"]) == (0.0, 1.0, 1.0)
    assert len(figures["partner_per_reference"]) == 14


def test_points_are_compared_with_the_roofs_of_a_model(survey):
    score = run_score("models", survey / "truth.city.jsonl", survey / "points")
    figures = score.figures
    assert figures["point_uncovered"] == pytest.approx(0.0, abs=2e-3)
    assert figures["point_median"] == pytest.approx(0.05, abs=2e-3)
    assert figures["point_within_10_cm"] == pytest.approx(1, abs=5e-3)
    assert "point_rmse" in score.table()


def test_another_class_of_the_cloud_can_be_meant(survey):
    figures = run_score("models", survey, survey / "points", reference_classes=(2,)).figures
    assert figures["n_roof_points"] == 0
    assert figures["point_median"] is None


def test_a_level_that_a_building_lacks_gives_no_solid(survey):
    figures = run_score("models", survey, survey, lod="1.3").figures
    assert (figures["lod_22_share"], figures["lod_13_share"], figures["height_covered"]) == (0.0, 0.0, 0.0)
    with pytest.raises(ParameterError, match="--lod 3"):
        run_score("models", survey, survey, lod="3")


def test_plain_city_json_with_parts_in_feet_and_without_semantics_is_read(tmp_path):
    ring = [[0, 0], [10, 0], [10, 10], [0, 10]]
    vertices = [[*xy, z] for z in (0, 20) for xy in ring]
    shell = [[[3, 2, 1, 0]], [[4, 5, 6, 7]], *([[i, (i + 1) % 4, (i + 1) % 4 + 4, i + 4]] for i in range(4))]
    content = {
        "type": "CityJSON",
        "version": "2.0",
        "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/2263"},
        "CityObjects": {
            "house": {"type": "Building", "attributes": {"a": 1}, "children": ["part"], "geometry": []},
            "part": {
                "type": "BuildingPart",
                "parents": ["house"],
                "geometry": [{"type": "Solid", "lod": "2.2", "boundaries": [shell]}],
            },
            "tree": {"type": "SolitaryVegetationObject", "geometry": []},
        },
        "vertices": vertices,
    }
    path = tmp_path / "other.city.json"
    path.write_text(json.dumps(content))
    model = read_city_model(path)
    (building,) = model.buildings
    (solid,) = building.solids["2.2"]
    assert (model.crs, building.name, building.attributes) == ("EPSG:2263", "house", {"a": 1})
    assert solid.volume == pytest.approx(2000 * (1200 / 3937) ** 3)
    assert solid.semantics == ("GroundSurface", "RoofSurface", *("WallSurface",) * 4)


def test_a_sequence_ends_its_lines_with_line_feeds_alone(tmp_path):
    building = {"type": "Building", "attributes": {"name": "a\u2028b\x85c"}, "geometry": []}
    feature = {"type": "CityJSONFeature", "id": "h", "CityObjects": {"h": building}, "vertices": []}
    header = {"type": "CityJSON", "version": "2.0", "CityObjects": {}, "vertices": []}
    path = tmp_path / "names.city.jsonl"
    lines = [json.dumps(one, ensure_ascii=False) for one in (header, feature)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (found,) = read_city_model(path).buildings
    assert found.attributes["name"] == "a\u2028b\x85c"


def test_what_is_no_city_model_is_refused(survey, tmp_path):
    with pytest.raises(InputError, match="contains no"):
        run_score("models", tmp_path, survey)
    (tmp_path / "bad.city.jsonl").write_text('{"type": "Feature"}\n')
    with pytest.raises(InputError, match="cannot be read as CityJSON"):
        run_score("models", tmp_path, survey)
    (tmp_path / "binary.gpkg").write_bytes(b"\xa0" * 100_000)
    with pytest.raises(InputError, match="cannot be read as CityJSON: UnicodeDecodeError: ") as refused:
        run_score("models", survey, tmp_path / "binary.gpkg")
    assert len(str(refused.value)) < 500
    with pytest.raises(InputError, match="no such file"):
        run_score("models", tmp_path / "none.city.jsonl", survey)


def test_every_figure_of_models_is_explained(survey):
    page = (ROOT / "doc" / "scores.md").read_text(encoding="utf-8")
    for reference in (survey, survey / "points"):
        figures = run_score("models", survey, reference).figures
        assert [name for name in figures if f"`{name}`" not in page] == []
