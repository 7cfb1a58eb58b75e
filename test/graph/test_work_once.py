"""No tile goes through a stage twice unless a node died with it, however slow the machine is."""

import os
import threading
from collections import Counter

import pytest
from support.node_bench import running
from support.results import assert_complete

from lidar_buildings.io.clouds import cloud
from lidar_buildings.io.clouds.cloud import open_reader
from lidar_buildings.nodes import model_writer, stage_nodes
from lidar_buildings.nodes.graph import survey_nodes
from lidar_buildings.nodes.tile_player import TilePlayer
from lidar_buildings.ros.node_state import IN_HAND
from lidar_buildings.ros.stamps import tile_of

pytestmark = pytest.mark.graph

#: Node → what it calls with a tile first; the writer's work begins with the rasters.
WORK = {
    "ground_filter": "filter_ground",
    "roof_selector": "select_roof_points",
    "edge_labeller": "label_roof_edges",
    "building_tracer": "trace_or_close",
    "outline_regulariser": "regularise_outlines",
    "facade_finder": "map_tile_facades",
    "plane_fitter": "fit_planes",
    "model_builder": "build_models",
    "model_writer": "rasterise_tile",
}
#: More than ten times what a tile may take in silence [s].
LONG = 1000.0


class SlowedGraph:
    """All nodes in one process; by the player's clock every stage takes ages, while the player goes on."""

    def __init__(self, survey, output, context, monkeypatch):
        self.calls = Counter()
        self._ticks, self._leap = threading.Condition(), 0.0
        for node, name in WORK.items():
            module = model_writer if node == "model_writer" else stage_nodes
            monkeypatch.setattr(module, name, self._slowed(node, getattr(module, name)))
        monkeypatch.setattr(TilePlayer, "on_timer", self._ticking(TilePlayer.on_timer))
        settings = {"tile_player": {"tile_size": 25.0, "buffer": 5.0}}
        place = {"context": context, "namespace": f"once_{os.getpid()}"}
        self.nodes = survey_nodes([str(survey)], str(output), settings=settings, **place)

    def run(self):
        with running(*self.nodes.values()) as composition:
            assert composition.wait(self.nodes["model_writer"], timeout=300.0)
        return self.nodes["model_writer"].outcome.result()

    def _ticking(self, on_timer):
        def tick(player):
            with self._ticks:
                player._time, self._leap = player._time + self._leap, 0.0
            on_timer(player)
            with self._ticks:
                self._ticks.notify_all()

        return tick

    def _slowed(self, node, work):
        def slow(tile, *more, **named):
            # outlines have no stamp, but a tile's are no other tile's; a tile sent larger is another one
            stamp = getattr(tile, "stamp", None)
            self.calls[node, stamp, len(tile) if stamp is not None else tuple(tile)] += 1
            player = self.nodes["tile_player"]
            with self._ticks:
                assert self._ticks.wait_for(lambda: node in has_in_hand(player), 240.0)
                self._leap += LONG
                assert all(self._ticks.wait(240.0) for _ in range(2))
            return work(tile, *more, **named)

        return slow


def has_in_hand(player):
    """Nodes that have a tile in hand, as the player knows."""
    states = [one.state for one in list(player._ledger._nodes.values())]
    return {one.node for one in states if any(at.status == IN_HAND for at in one.tiles.values())}


@pytest.fixture
def graph(context, house, tmp_path, monkeypatch):
    return SlowedGraph(house, tmp_path / "out", context, monkeypatch)


def test_every_stage_works_once_on_each_tile_of_a_graph_slower_than_any_timeout(graph, house, tmp_path):
    summary = graph.run()
    n_tiles = summary.n_tiles
    assert n_tiles == 9
    assert_complete(house, tmp_path / "out", min_tiles=n_tiles)
    with_stamp = {key: number for key, number in graph.calls.items() if key[1] is not None}
    assert set(with_stamp.values()) == {1}
    # empty outlines are alike
    assert sum(number for key, number in graph.calls.items() if key[1] is None) == n_tiles
    assert {node for node, *_ in graph.calls} == set(WORK)
    for node in set(WORK) - {"outline_regulariser"}:
        assert len({tile_of(stamp) for name, stamp, _ in graph.calls if name == node}) == n_tiles
    # what comes after tracing sees a tile of which a building was cut off only once it is large enough
    assert sum(node in ("plane_fitter", "model_builder") for node, *_ in graph.calls) == 2 * n_tiles


def test_files_are_decoded_once_in_a_process_that_reads_and_writes_them(
    context, house, tmp_path, monkeypatch
):
    opened = Counter()

    def noted(path):
        opened[path] += 1
        return open_reader(path)

    monkeypatch.setattr(cloud, "open_reader", noted)
    output, files = tmp_path / "out", sorted(house.glob("*.laz"))
    nodes = survey_nodes([str(house)], str(output), context=context, namespace=f"once_{os.getpid()}")
    with running(*nodes.values()) as composition:
        assert composition.wait(nodes["model_writer"], timeout=300.0)
        assert nodes["model_writer"].outcome.result().n_points
    of_report = [output / "classified" / file.name for file in files]
    assert opened == dict.fromkeys([*files, *of_report], 1)
    assert_complete(house, output)
