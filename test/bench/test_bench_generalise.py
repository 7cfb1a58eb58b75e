import numpy as np
import pytest

from bench.common.clouds import Cloud
from bench.generalise import ceiling, corners, ground, run
from bench.generalise.disturbances import KINDS, disturbances
from lidar_buildings.evaluation.scores.models import Wireframe, roof_wireframe
from lidar_buildings.pipeline.config import PipelineConfig

CHANCE = np.random.default_rng(5)
POINTS = CHANCE.uniform(0.0, 100.0, (4000, 3))
TIMES = np.repeat(np.arange(2000.0), 2)


@pytest.mark.parametrize("kind", KINDS)
def test_disturbed_points_are_the_clouds_own_wherever_they_were_moved(kind):
    for one in disturbances(POINTS, {"gps_time": TIMES}, kinds=[kind]):
        away = np.abs(one.points - one.moved(POINTS[one.rows])).max()
        assert away < (0.2 if kind == "noisy" else 1e-9)
        assert len(np.unique(one.rows)) == len(one.rows) >= 50
        for name, column in one.columns.items():
            assert (column == {"gps_time": TIMES}[name][one.rows]).all()


def test_thinning_keeps_or_drops_all_returns_of_a_pulse():
    (half,) = disturbances(POINTS, {"gps_time": TIMES}, kinds=["half"])
    assert (np.unique(half.columns["gps_time"], return_counts=True)[1] == 2).all()
    assert 0.4 < len(half.rows) / len(POINTS) < 0.6


def test_the_command_prints_a_line_per_disturbance(capsys, monkeypatch):
    cloud = Cloud(POINTS * [1.0, 1.0, 0.001], {}, np.ones(len(POINTS), dtype=bool))
    monkeypatch.setattr(ground, "read_clouds", lambda data, names: {"flat": cloud})
    run.main(["--parts", "ground", "--quick"])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines[3:-1]] == ["plain", *KINDS, "all"]


def test_a_roof_drawn_as_it_stands_has_all_its_corners_and_edges():
    x, y = (each.ravel() + CHANCE.uniform(-0.1, 0.1, 1200) for each in np.mgrid[0.1:10:40j, 0.1:8:30j])
    roof = np.column_stack([x, y, 3.0 - 0.6 * np.abs(y - 4.0)])
    (solid,) = corners.solids_of(roof, PipelineConfig())
    drawn = roof_wireframe([solid])
    counts = corners.counts_of(roof, drawn, [solid])
    assert len(drawn.corners) == counts.near == counts.corners == counts.corners_drawn == 6
    assert counts.edges_paired == counts.edges == counts.edges_drawn == 7
    assert counts.n_on_model == counts.n_points == 1200
    assert corners.corner_table({"plain": [counts]}).splitlines()[-1].split()[2] == "1.000"


def test_a_drawn_roof_moves_to_where_its_points_end():
    x, y = np.random.default_rng(7).uniform(0.0, [[10.0], [8.0]], (2, 1600))
    points = np.column_stack([x, y, 3.0 - 0.6 * np.abs(y - 4.0)])
    true = np.array([[0, 0, 0.6], [10, 0, 0.6], [10, 8, 0.6], [0, 8, 0.6], [0, 4, 3], [10, 4, 3.0]])
    edges = np.array([[0, 1], [1, 5], [4, 5], [0, 4], [2, 5], [2, 3], [3, 4]])
    drawn = true + np.array([0.5, 0.4, 0.1])
    roof = corners.DrawnRoof("gable", points, Wireframe(drawn, edges, np.zeros(7, dtype=bool)))
    assert np.abs(ceiling.adjusted(roof).corners - true).max() < 0.15
    heights = ceiling.adjusted(roof, ceiling.HEIGHTS).corners
    assert (np.abs(heights[:, :2] - drawn[:, :2]) < 1e-3).all()
