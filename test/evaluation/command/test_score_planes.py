"""``lidar-buildings score planes`` on tiny files: numbers, the truth of simulations, and colours."""

import json

import numpy as np
import pytest
from support.score_files import write_cloud
from support.source_tree import ROOT

from lidar_buildings.cli import main
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.evaluation.command.score import run_score

SPACING = 0.3


@pytest.fixture
def roof():
    """
    A roof of two slopes, seen from above in the west and in the east, and the number of each point's slope.
    """
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 9, SPACING), np.arange(0, 6, SPACING)))
    return np.column_stack((x, y, 5 - abs(x - 4.35))), np.where(x < 4.35, 1, 2).astype(np.uint16)


def test_numbers_are_compared_with_numbers(tmp_path, roof):
    points, plane = roof
    result = write_cloud(
        tmp_path / "result.laz", points, PlaneId=np.where(plane == 1, 9, 0).astype(np.uint16)
    )
    reference = write_cloud(tmp_path / "reference.laz", points, PlaneId=plane)
    figures = run_score("planes", result, reference).figures
    assert (figures["n_planes_result"], figures["n_planes_reference"], figures["n_planes_found"]) == (1, 2, 1)
    assert (figures["precision"], figures["recall"]) == (1.0, 0.5)
    assert figures["weighted_coverage"] == pytest.approx(0.5)


def test_a_plane_number_counts_within_its_building(tmp_path, roof):
    points, plane = roof
    one, building = np.ones_like(plane), plane.astype(np.uint32)
    result = write_cloud(tmp_path / "result.laz", points, PlaneId=one, BuildingId=building)
    reference = write_cloud(
        tmp_path / "truth.laz", points, TruePlane=one, TrueBuilding=building, PlaneId=np.zeros_like(one)
    )
    assert run_score("planes", result, reference).figures["f1"] == 1.0


def test_a_colour_holds_as_many_planes_as_parts_and_black_is_none(tmp_path, roof):
    points, _ = roof
    x = points[:, 0]
    plane = np.digitize(x, [3.0, 6.0]).astype(np.uint16) + 1
    colour = np.array([[255, 0, 0], [0, 255, 0], [255, 0, 0]])[plane - 1] * 256
    colour[points[:, 1] < 1.0] = 0
    result = write_cloud(tmp_path / "result.laz", points, PlaneId=plane)
    reference = write_cloud(tmp_path / "reference.laz", points, colour=colour)
    figures = run_score("planes", result, reference).figures
    assert figures["n_points"] == np.count_nonzero(points[:, 1] >= 1.0)
    assert figures["n_planes_reference"] == 3
    assert figures["weighted_coverage"] == 1.0


def test_clouds_are_scored_together(tmp_path, roof, capsys):
    points, plane = roof
    for name, found in (("a", plane), ("b", np.ones_like(plane))):
        write_cloud(tmp_path / "result" / f"{name}.laz", points, PlaneId=found)
        write_cloud(tmp_path / "reference" / f"{name}.laz", points, PlaneId=plane)
    arguments = ["score", "planes", str(tmp_path / "result"), str(tmp_path / "reference")]
    assert main([*arguments, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["n_planes_result"] == 3
    assert (figures["n_clouds"], figures["n_planes_reference"], figures["recall"]) == (2, 4, 0.75)
    assert main(arguments) == 0
    assert "weighted_coverage" in capsys.readouterr().out


def test_clouds_that_say_nothing_of_planes_or_hold_other_points_are_refused(tmp_path, roof):
    points, plane = roof
    plain = write_cloud(tmp_path / "plain.laz", points)
    good = write_cloud(tmp_path / "good.laz", points, PlaneId=plane)
    moved = write_cloud(tmp_path / "moved.laz", np.add(points, [0.5, 0, 0]), PlaneId=plane)
    with pytest.raises(InputError, match=r"plain.laz: has no dimension PlaneId"):
        run_score("planes", plain, good)
    with pytest.raises(InputError, match=r"plain.laz: has no dimension TruePlane or PlaneId or colours"):
        run_score("planes", good, plain)
    with pytest.raises(InputError, match="has other coordinates"):
        run_score("planes", good, moved)


def test_every_figure_of_planes_is_explained(tmp_path, roof):
    points, plane = roof
    cloud = write_cloud(tmp_path / "roof.laz", points, PlaneId=plane)
    page = (ROOT / "doc" / "scores.md").read_text(encoding="utf-8")
    figures = run_score("planes", cloud, cloud).figures
    assert [name for name in figures if f"`{name}`" not in page] == []
