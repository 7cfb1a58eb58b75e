"""The benchmark of outlines, on houses small enough for a test."""

import importlib.util

import numpy as np
import pytest
import shapely
from shapely import box
from support.lawn import HOUSES, houses_on_a_lawn, write_las
from support.score_files import write_polygons
from support.source_tree import ROOT

from bench.common import arguments
from bench.models import clouds as model_clouds
from bench.outlines import clouds as outline_clouds
from bench.outlines import peers as outline_peers
from bench.outlines import run as outlines
from bench.outlines import table1 as outline_table1
from bench.outlines import truth as outline_truth
from bench.outlines.streets import HEADINGS, drive_through, streets_table
from bench.scenes.outlines import outline_scene
from lidar_buildings.pipeline.config import PipelineConfig

CORNER = np.array([85_000.0, 447_000.0])


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """
    A data folder: two houses on a lawn with class 6, once with a map, once without classes; and a roof alone.
    """
    folder = tmp_path_factory.mktemp("data")
    points, roof = houses_on_a_lawn()
    classes = np.where(roof, 6, 2)
    west = points[:, 0] < 20
    write_las(folder / "delft" / "a.laz", points[west], classes[west])
    write_las(folder / "delft" / "b.laz", points[~west], classes[~west])
    write_las(folder / "toronto" / "a.laz", points, np.ones(len(points)))
    write_las(folder / "trondheim" / "1.laz", points[roof & west], np.zeros((roof & west).sum()))
    write_las(folder / "trondheim" / "2.laz", points[roof & ~west], np.zeros((roof & ~west).sum()))
    (folder / "bad").mkdir()
    (folder / "bad" / "a.laz").write_bytes(b"no cloud")
    write_polygons(folder / "delft" / "blocks_nw.gpkg", [box(*house) for house in HOUSES])
    write_polygons(folder / "delft" / "aoi_nw.gpkg", [box(0, 0, 40, 24)])
    return folder


def lines_of(text, first):
    return [line for line in text.splitlines() if line.startswith(first)]


def test_the_truth_itself_is_found_with_all_its_corners_and_courtyards():
    scene = outline_scene("courtyard", density=2.0)
    right = outline_truth.verdict(scene, [scene.truth])
    assert (right.is_found, right.corners_right, right.n_courtyards_found) == (True, True, 1)
    assert right.iou == pytest.approx(1.0)
    assert right.distances["hausdorff"] == pytest.approx(0.0, abs=1e-9)
    assert right.angle_95_deg == pytest.approx(0.0, abs=1e-6)


def test_a_filled_courtyard_two_buildings_for_one_and_none_are_told():
    scene = outline_scene("courtyard", density=2.0)
    filled = outline_truth.verdict(scene, [shapely.Polygon(scene.truth.exterior)])
    assert (filled.is_found, filled.corners_right, filled.n_courtyards_found) == (True, False, 0)
    # 32 × 26 m with a courtyard of 14 × 10 m.
    assert filled.iou == pytest.approx(1 - 140 / 832)
    assert not outline_truth.verdict(scene, [scene.truth, box(900, 900, 901, 901)]).is_found
    nothing = outline_truth.verdict(scene, [])
    assert (nothing.is_found, nothing.iou, nothing.n_vertices) == (False, 0.0, 0)
    cells = outline_truth.summary_cells([filled, nothing])
    assert (cells[0], cells[1], cells[3], cells[5]) == ("2", "1", "0.000", "0/2")


def test_scenes_are_measured_for_ours_and_a_peer(tmp_path, capsys):
    arguments = ["--parts", "scenes", "--plans", "rectangle_30_18", "round_tower_8", "--density", "3"]
    outlines.main([*arguments, "--methods", "ours", "concave_hull", "--pictures", str(tmp_path)])
    output = capsys.readouterr().out
    ours = lines_of(output, "rectangle_30_18")[0].split()
    assert (ours[1], ours[2], ours[5]) == ("12", "12", "100.0")
    assert float(ours[3]) > 0.93
    assert len(lines_of(output, "all rectilinear")) == len(lines_of(output, "all curved")) >= 2
    drawn = sorted(path.name for path in tmp_path.glob("*.png"))
    assert drawn[0] == "scenes_concave_hull.png"
    assert drawn[1].startswith("scenes_ours")


def test_delft_is_measured_on_the_same_clusters_for_all(data, tmp_path, capsys):
    methods = ["ours", "concave_hull", "concave_hull_simplified"]
    arguments = ["--data", str(data), "--parts", "delft", "--repeats", "1", "--pictures", str(tmp_path)]
    outlines.main([*arguments, "--methods", *methods])
    output = capsys.readouterr().out
    assert "provider classes), 2 clusters" in output
    for method in ("ours, through", "ours, bias", "ours, alpha", "concave_hull ", "concave_hull_simplified "):
        quality, times = lines_of(output, method)[-2:]
        assert "2/2" in quality
        assert float(times.split()[-1]) > 0
    assert lines_of(output, "Ours: segmentation")
    assert len(list(tmp_path.glob("delft_*.png"))) >= 3


def test_clouds_are_read_by_their_classes_or_their_own(data):
    found = dict(model_clouds.clouds_in(data))
    assert list(found) == ["delft", "toronto", "trondheim/1", "trondheim/2"]
    delft, toronto = (outline_clouds.read_roofs(name, found[name]) for name in ("delft", "toronto"))
    _, roof = houses_on_a_lawn()
    assert (delft.classes, toronto.classes) == ("provider", "own")
    assert len(delft.roofs) == roof.sum()
    assert len(toronto.roofs) == pytest.approx(roof.sum(), rel=0.05)
    np.testing.assert_allclose(np.ptp(delft.extent, axis=0), (40, 24), atol=0.5)


def test_table_1_has_the_papers_lines_and_ten_virtual_buildings():
    row = outline_table1.row_of_survey(outline_table1.SURVEYS[1], PipelineConfig())
    assert len(row.buildings) == 10
    assert row.score.spacing == pytest.approx(1.2, rel=0.15)
    text = outline_table1.table_1([row])
    assert lines_of(text, "paper: Baltimore")[0].split()[3:6] == ["2.70", "2.40", "0.89"]
    slope, deviation = outline_table1.slope_through_origin([row], "sigma")
    assert slope == pytest.approx(row.score.sigma / row.score.spacing)
    assert deviation == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", outline_peers.PEERS)
def test_a_peer_makes_one_outline_per_cluster(name):
    if importlib.util.find_spec(outline_peers.PEERS[name]) is None:
        pytest.skip(f"{name} is not installed")
    clusters = [outline_scene("l_shape", density=8.0, seed=seed).points for seed in (1, 2)]
    result = outline_peers.run_peer(name, clusters)
    assert len(result.polygons) == 2
    assert all(abs(polygon.area / 340 - 1) < 0.1 for polygon in result.polygons)
    assert result.seconds > 0


def test_settings_name_their_stage():
    configs = arguments.config_of(["segmentation.min_points=5"], segmentation={"split_at_steps": True})
    assert (configs.segmentation.min_points, configs.segmentation.split_at_steps) == (5, True)
    assert arguments.config_of([]) == PipelineConfig()
    with pytest.raises(SystemExit, match=r"must be STAGE\.NAME=VALUE"):
        arguments.config_of(["min_points=5"])
    with pytest.raises(SystemExit, match="there is no stage 'colour'"):
        arguments.config_of(["colour.red=1"])


def test_missing_clouds_are_named_and_pictures_stay_out_of_the_repository(tmp_path, capsys):
    outlines.main(["--data", str(tmp_path / "nowhere"), "--parts", "delft", "table1"])
    spoken = capsys.readouterr()
    assert spoken.out == ""
    assert spoken.err.count("is not there: give the real clouds with --data") == 2
    with pytest.raises(SystemExit, match="inside the repository"):
        outlines.main(["--pictures", str(ROOT / "bench" / "pictures")])


def test_terraces_from_the_street_are_whole():
    street = drive_through("dense_block", 1, PipelineConfig(), rate=30_000.0)
    cells = dict(zip(HEADINGS, street.cells(), strict=True))
    assert (cells["buildings"], cells["outlines"], cells["whole"]) == ("16", "2", "16")
    assert float(cells["IoU of all"]) > 0.97
    assert streets_table([street]).count("\n") == 2
