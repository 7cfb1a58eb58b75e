"""The running graph as a table."""

from lidar_buildings.commands.top import GraphView

OK, WARN, ERROR = range(3)


def cells(view, now, node):
    (row,) = (line for line in view.lines(now) if line.startswith(f"{node} "))
    return row.split()


def test_a_row_says_what_a_node_does_and_how_fast():
    view = GraphView()
    work = {"tiles_in": 3, "tiles_out": 2, "points_in": 3000, "seconds": 1.5, "seconds_last_tile": 0.5}
    view.hear("plane_fitter", OK, "working on tile 7", work | {"input_age": 2.0, "tiles_in_hand": 1}, 0.0)
    expected = "plane_fitter at work 3 2 1 2,000 0.50 s 3 s ok working on tile 7"
    assert cells(view, 1.0, "plane_fitter") == expected.split()
    view.hear("plane_fitter", OK, "idle", {}, 2.0)
    idle = "plane_fitter idle 0 0 0 - - - ok idle"
    assert cells(view, 2.0, "plane_fitter") == idle.split()
    assert "silent 9 s" in view.lines(11.0)[1]


def test_levels_and_what_is_wrong_are_said():
    view = GraphView()
    view.hear("a", WARN, "points were left out", {"tiles_in": 1}, 0.0)
    view.hear("b", ERROR, "no disk", {"tiles_in": 1}, 0.0)
    assert view.lines(0.0)[1].endswith("WARN   points were left out")
    assert view.lines(0.0)[2].endswith("ERROR  no disk")


def test_tiles_of_the_source_and_buildings_stand_beneath_in_the_order_of_the_chain():
    view = GraphView(["tile_player", "model_builder"])
    gauges = {"tiles_done": 5, "tiles_in_flight": 2, "tiles_given_up": 1, "latency": 3.14, "points_in": 9}
    view.hear("tile_player", OK, "idle", gauges | {"seconds": 0.1}, 0.0)
    feed = {"scans": 7, "points": 5000, "points_waiting": 20, "tiles_waiting": 4, "left out: no pose": 3}
    view.hear("scan_assembler", OK, "idle", feed, 0.0)
    view.hear("model_builder", OK, "idle", {"buildings_ok": 1200, "buildings_no_solid": 3}, 0.0)
    assert view.lines(0.0)[-3:] == [
        "tile_player: 5 tiles done, 2 in flight, 1 given up; the last took 3.1 s",
        "model_builder: buildings: 3 no_solid, 1,200 ok",
        "scan_assembler: 7 scans, 5,000 points kept, 20 to be placed, 3 left out; 4 tiles queued",
    ]
    assert cells(view, 0.0, "tile_player")[5] == "-"


def test_nodes_that_share_tiles_stand_together():
    view = GraphView(["ground_filter", "roof_selector"])
    for name in ("roof_selector", "other", "ground_filter_2", "ground_filter"):
        view.hear(name, OK, "idle", {"tiles_in": 1}, 0.0)
    names = [line.split()[0] for line in view.lines(0.0)[1:]]
    assert names == ["ground_filter", "ground_filter_2", "roof_selector", "other"]
