"""The running graph as a table."""

from lidar_buildings.ros.graph_view import GraphView
from lidar_buildings.ros.node_summary import ERROR, OK, WARN
from lidar_buildings.ros.tile_ledger import IN_HAND, NodeState, TileState

WORK = {"tiles_in": 3, "tiles_out": 2, "points_in": 3000, "seconds": 1.5, "seconds_last_tile": 0.5}


def state(node, life, *stamps):
    return NodeState(node, life, 1, {stamp: TileState(IN_HAND) for stamp in stamps})


def cells(view, now, node):
    (row,) = (line for line in view.lines(now) if line.startswith(f"{node} "))
    return row.split()


def test_a_node_is_at_work_from_taking_a_tile_to_ending_it():
    view = GraphView()
    view.hear_state(state("plane_fitter", "life"), 0.0)
    assert not view.has_all
    view.hear_summary("plane_fitter", OK, "idle", WORK | {"input_age": 2.0}, 0.0)
    assert view.has_all
    view.hear_state(state("plane_fitter", "life", 7), 1.0)
    expected = [
        "plane_fitter",
        "at",
        "work",
        "3",
        "2",
        "1",
        "2,000",
        "0.50",
        "s",
        "3",
        "s",
        "ok",
        "tile",
        "7",
    ]
    assert cells(view, 1.0, "plane_fitter") == expected
    assert cells(view, 90.0, "plane_fitter")[1:3] == ["at", "work"], "who works cannot speak"
    view.hear_state(state("plane_fitter", "life"), 91.0)
    assert cells(view, 91.0, "plane_fitter")[1] == "idle"


def test_a_node_that_died_with_a_tile_has_it_no_more_when_it_is_back():
    view = GraphView()
    view.hear_state(state("model_builder", "life", 7), 0.0)
    view.hear_state(state("model_builder", "another"), 1.0)
    assert cells(view, 1.0, "model_builder")[1:5] == ["idle", "-", "-", "0"]
    assert "silent 9 s" in view.lines(10.0)[1]


def test_levels_and_what_is_wrong_are_said():
    view = GraphView()
    view.hear_summary("a", WARN, "points were left out", {"tiles_in": 1}, 0.0)
    view.hear_summary("b", ERROR, "no disk", {"tiles_in": 1}, 0.0)
    assert view.lines(0.0)[1].endswith("WARN   points were left out")
    assert view.lines(0.0)[2].endswith("ERROR  no disk")


def test_tiles_of_the_source_and_buildings_stand_beneath_in_the_order_of_the_chain():
    view = GraphView(["tile_player", "model_builder"])
    gauges = {"tiles_done": 5, "tiles_in_flight": 2, "tiles_given_up": 1, "latency": 3.14, "points_in": 9}
    view.hear_summary("tile_player", OK, "idle", gauges | {"seconds": 0.1}, 0.0)
    feed = {"scans": 7, "points": 5000, "points_waiting": 20, "tiles_waiting": 4, "left out: no pose": 3}
    view.hear_summary("scan_assembler", OK, "idle", feed, 0.0)
    view.hear_summary("model_builder", OK, "idle", {"buildings_ok": 1200, "buildings_no_solid": 3}, 0.0)
    assert view.lines(0.0)[-3:] == [
        "tile_player: 5 tiles done, 2 in flight, 1 given up; the last took 3.1 s",
        "model_builder: buildings: 3 no_solid, 1,200 ok",
        "scan_assembler: 7 scans, 5,000 points kept, 20 to be placed, 3 left out; 4 tiles queued",
    ]
    assert cells(view, 0.0, "tile_player")[5] == "-"


def test_nodes_that_share_tiles_stand_together():
    view = GraphView(["ground_filter", "roof_selector"])
    for name in ("roof_selector", "other", "ground_filter_2", "ground_filter"):
        view.hear_summary(name, OK, "idle", {"tiles_in": 1}, 0.0)
    names = [line.split()[0] for line in view.lines(0.0)[1:]]
    assert names == ["ground_filter", "ground_filter_2", "roof_selector", "other"]
