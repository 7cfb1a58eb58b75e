"""``lidar-buildings score edges`` on tiny files whose figures are worked out by hand."""

import json

import numpy as np
import pytest
import shapely
from support.score_files import write_cloud, write_polygons

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.evaluation.command.score import run_score

STEP = 0.5


def write_labels(path, points, classes, edge, facade=None):
    """A classified file with edge labels, and marks of façades if given."""
    given = {"EdgeLabel": edge} | ({} if facade is None else {"Facade": facade})
    dimensions = {name: np.asarray(values, dtype=np.uint8) for name, values in given.items()}
    return write_cloud(path, points, classes, **dimensions)


@pytest.fixture
def houses():
    """
    Points of a lattice, classes and the rims of two roofs: of 10 × 8 m in the west, of 6 × 8 m in the east.
    """
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0.25, 40, STEP), np.arange(0.25, 20, STEP)))
    roof = np.zeros(len(x), dtype=int)
    rim = np.zeros(len(x), dtype=bool)
    for number, (west, east) in enumerate(((5, 15), (25, 31)), start=1):
        inside = (x > west) & (x < east) & (y > 6) & (y < 14)
        roof[inside] = number
        rim |= inside & ((x < west + STEP) | (x > east - STEP) | (y < 6 + STEP) | (y > 14 - STEP))
    points = np.column_stack((x, y, np.where(roof > 0, 7.0, 0.0)))
    return points, np.where(roof > 0, 6, 2), rim


#: Points on the rims of the two roofs, and on both roofs.
WEST_RIM, EAST_RIM, BOTH = 2 * (20 + 16) - 4, 2 * (12 + 16) - 4, 20 * 16 + 12 * 16


def test_the_rims_of_roofs_are_the_edges_of_a_cloud_and_of_polygons(tmp_path, houses):
    points, classes, rim = houses
    result = write_labels(tmp_path / "out" / "classified" / "a.laz", points, classes, rim)
    cloud = write_cloud(tmp_path / "survey" / "a.laz", points, np.zeros_like(classes), truth=classes)
    polygons = write_polygons(tmp_path / "map.gpkg", [shapely.box(25, 6, 31, 14), shapely.box(5, 6, 15, 14)])
    for reference in (cloud, polygons):
        for mine in (result, tmp_path / "out"):
            figures = run_score("edges", mine, reference).figures
            assert (figures["n_points"], figures["n_unlabelled"], figures["n_roofs"]) == (BOTH, 0, 2)
            assert figures["n_edges_reference"] == figures["n_edges_result"] == WEST_RIM + EAST_RIM
            assert figures["edge_f_score"] == figures["non_edge_f_score"] == 1.0
            assert figures["spacing"] == pytest.approx(STEP, rel=0.1)
            assert figures["alpha"] == pytest.approx(1.342 * figures["spacing"], rel=1e-3)


def test_figures_of_labels_that_are_partly_wrong(tmp_path, houses):
    points, classes, rim = houses
    # None of the eastern rim is found; ten points within the western roof are taken for edges.
    edge = rim & (points[:, 0] < 20)
    inner = np.flatnonzero((classes == 6) & ~rim)[:10]
    edge[inner] = True
    result = write_labels(tmp_path / "a.laz", points, classes, edge)
    figures = run_score("edges", result, write_cloud(tmp_path / "b.laz", points, classes)).figures
    assert figures["edge_completeness"] == pytest.approx(WEST_RIM / (WEST_RIM + EAST_RIM))
    assert figures["edge_correctness"] == pytest.approx(WEST_RIM / (WEST_RIM + 10))
    n_others = BOTH - WEST_RIM - EAST_RIM
    assert figures["non_edge_completeness"] == pytest.approx((n_others - 10) / n_others)


def test_roof_points_that_the_result_does_not_have_are_counted_and_not_judged(tmp_path, houses):
    points, classes, rim = houses
    lost = (classes == 6) & (points[:, 0] > 29)
    mine = np.where(lost, 1, classes)
    new_rim = (classes == 6) & (abs(points[:, 0] - 28.75) < 0.1)
    result = write_labels(tmp_path / "a.laz", points, mine, (rim | new_rim) & ~lost)
    references = (
        write_cloud(tmp_path / "b.laz", points, classes),
        write_polygons(tmp_path / "map.gpkg", [shapely.box(5, 6, 15, 14), shapely.box(25, 6, 31, 14)]),
    )
    for reference in references:
        figures = run_score("edges", result, reference).figures
        assert figures["n_unlabelled"] == lost.sum() == 4 * 16
        assert figures["n_points"] == BOTH - lost.sum()
        assert figures["edge_f_score"] == 1.0


def test_facades_are_no_roof_points(tmp_path, houses):
    points, classes, rim = houses
    wall = (points[:, 0] > 15) & (points[:, 0] < 16) & (points[:, 1] > 6) & (points[:, 1] < 14)
    mine = np.where(wall, 6, classes)
    reference = write_cloud(tmp_path / "b.laz", points, mine)
    result = write_labels(tmp_path / "a.laz", points, mine, rim, wall)
    figures = run_score("edges", result, reference).figures
    assert figures["n_unlabelled"] == wall.sum() == 2 * 16
    assert figures["n_points"] == BOTH
    assert figures["edge_f_score"] == 1.0
    # Where no dimension says so, nothing tells them from roofs.
    result = write_labels(tmp_path / "c.laz", points, mine, rim)
    figures = run_score("edges", result, reference).figures
    assert figures["n_points"] == BOTH + wall.sum()
    assert figures["edge_f_score"] < 0.9


@pytest.mark.parametrize(("until", "refused"), [("roof_selection", True), ("edge_labelling", False)])
def test_a_run_that_ended_before_the_edges_is_refused(tmp_path, houses, until, refused):
    points, classes, rim = houses
    reference = write_cloud(tmp_path / "b.laz", points, classes)
    write_labels(tmp_path / "run" / "classified" / "b.laz", points, classes, rim)
    (tmp_path / "run" / "run.json").write_text(json.dumps({"until": until}))
    if refused:
        with pytest.raises(InputError, match="the run ended after roof_selection"):
            run_score("edges", tmp_path / "run", reference)
    else:
        assert run_score("edges", tmp_path / "run", reference).figures["edge_f_score"] == 1.0


def test_the_area_of_interest_takes_points_and_cuts_no_roof(tmp_path, houses):
    points, classes, rim = houses
    result = write_labels(tmp_path / "a.laz", points, classes, rim)
    reference = write_cloud(tmp_path / "b.laz", points, classes)
    area = write_polygons(tmp_path / "aoi.gpkg", [shapely.box(0, 0, 10, 20)])
    figures = run_score("edges", result, reference, aoi=area).figures
    assert (figures["n_points"], figures["n_roofs"]) == (10 * 16, 1)
    assert figures["n_edges_reference"] == 2 * 10 + 14
    assert figures["edge_f_score"] == 1.0


def test_classes_of_the_reference_can_be_given(tmp_path, houses):
    points, classes, rim = houses
    result = write_labels(tmp_path / "a.laz", points, classes, rim)
    other = write_cloud(tmp_path / "b.laz", points, np.where(classes == 6, 26, 1))
    assert run_score("edges", result, other).figures["n_points"] == 0
    assert run_score("edges", result, other, reference_classes=(26,)).figures["edge_f_score"] == 1.0


def test_a_result_without_points_has_figures_of_nothing(tmp_path):
    none = write_labels(tmp_path / "a.laz", np.zeros((0, 3)), [], [])
    polygons = write_polygons(tmp_path / "map.gpkg", [shapely.box(0, 0, 1, 1)])
    for reference in (none, polygons):
        figures = run_score("edges", none, reference).figures
        assert (figures["n_points"], figures["n_roofs"]) == (0, 0)
        assert figures["edge_f_score"] is None


def test_clouds_without_edge_labels_are_refused(tmp_path, houses):
    points, classes, rim = houses
    labelled = write_labels(tmp_path / "a.laz", points, classes, rim)
    bare = write_cloud(tmp_path / "b.laz", points, classes)
    with pytest.raises(InputError, match=r"b.laz: has no dimension EdgeLabel: give the output of"):
        run_score("edges", bare, labelled)
