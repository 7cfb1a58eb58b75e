"""The benchmarks of walls seen from the street, on lines and points that are known."""

import json

import numpy as np
import pytest
import shapely

from bench.street.drive import cells, read_drawn
from bench.street.lines import wall_score
from bench.street.planes import vertical_planes
from bench.street.walls import Lines, score_files
from lidar_buildings.io.vectors.layers import VectorLayer, geopackage_file

WALLS = [shapely.LineString([(0, 0), (10, 0)]), shapely.LineString([(10, 0), (10, 10)])]


def test_a_line_counts_by_its_length_within_the_tolerance():
    found = [shapely.LineString([(0, 0.05), (5, 0.05)]), shapely.LineString([(0, 3), (5, 3)])]
    score = wall_score(found, [], WALLS[:1], WALLS, 0.1)
    assert (score.true_length, score.found_length) == pytest.approx((10.0, 10.0))
    assert score.completeness == pytest.approx(0.5, abs=0.02)
    assert score.correctness == pytest.approx(0.5)
    assert score.rmse == pytest.approx(0.05)
    assert wall_score(found, [], WALLS[:1], WALLS, 0.04).correctness == 0.0


def test_lines_across_a_wall_are_none_of_it():
    across = [shapely.LineString([(x, -0.2), (x, 0.2)]) for x in np.arange(0.1, 10, 0.1)]
    score = wall_score(across, [], WALLS[:1], WALLS[:1], 0.3)
    assert (score.completeness, score.correctness) == (0.0, 0.0)


def test_nothing_found_scores_nothing():
    score = wall_score([], [], WALLS, WALLS, 0.1)
    assert score.completeness == 0.0
    assert np.isnan([score.correctness, score.rmse]).all()


def test_planes_are_found_where_walls_stand():
    random = np.random.default_rng(0)
    along, z = random.uniform(0, 10, (2, 3000))
    noise = random.normal(0, 0.02, 3000)
    points = np.concatenate([np.column_stack([along, noise, z]), np.column_stack([10 + noise, along, z])])
    score = wall_score(vertical_planes(points), [], WALLS, WALLS, 0.1)
    assert min(score.completeness, score.correctness) > 0.97
    assert score.rmse < 0.01


def test_layers_of_lines_and_upright_polygons_are_scored_against_the_truth(tmp_path):
    upright = [
        shapely.Polygon([(*a, 1.0), (*b, 1.0), (*b, 6.0), (*a, 6.5)])
        for a, b in (line.coords for line in WALLS)
    ]
    with geopackage_file(tmp_path / "result.gpkg", "EPSG:25832") as add:
        add(VectorLayer("street_lines", WALLS, {"seen": int}, [{"seen": 1}, {"seen": 0}], "LineString"))
        add(VectorLayer("facades", upright, {}, [{}, {}], "Polygon Z"))
    with geopackage_file(tmp_path / "truth.gpkg", "EPSG:25832") as add:
        add(VectorLayer("walls", WALLS, {"seen": int}, [{"seen": 1}, {"seen": 1}], "LineString"))
    files = tmp_path / "result.gpkg", tmp_path / "truth.gpkg"
    lines, polygons = (score_files(*files, layer, 0.1) for layer in ("street_lines", "facades"))
    assert (lines.completeness, lines.correctness, lines.assumed_length) == pytest.approx((0.5, 1.0, 10.0))
    assert (polygons.completeness, polygons.correctness, polygons.found_length) == pytest.approx((1, 1, 20))


def test_lines_on_fences_are_wrong_and_facades_need_points(tmp_path):
    def feature(kind, xy, points_per_m=100.0):
        properties = {"kind": kind, "points_per_m": points_per_m}
        return {"properties": properties, "geometry": {"coordinates": xy}}

    lines = [[(0, 0), (10, 0)], [(0, 20), (10, 20)], [(0, 40), (10, 40)]]
    kinds = [("facade", 100.0), ("facade", 10.0), ("hedge_or_vegetation", 100.0)]
    features = [feature(kind, xy, n) for (kind, n), xy in zip(kinds, lines, strict=True)]
    (tmp_path / "walls.geojson").write_text(json.dumps({"features": features}))
    drawn = read_drawn(tmp_path / "walls.geojson")
    found = [shapely.LineString(lines[0]), shapely.LineString(lines[2])]
    _, length, share, called, _, wrong, nothing = cells("lines", drawn, Lines(found, []))
    assert (length, share, called, wrong, nothing) == ("10", "1.000", "20", "0.500", "0.000")
