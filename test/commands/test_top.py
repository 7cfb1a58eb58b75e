"""`lidar-buildings top` shows the graphs that run, or says that there is none."""

import pytest
from support.cli_runs import Command
from support.ros_domain import use_own_domain

pytest.importorskip("rclpy")
pytestmark = pytest.mark.graph


@pytest.fixture
def command(capfd):
    use_own_domain()
    return Command(capfd)


@pytest.fixture
def graph(context):
    """Two nodes of a graph that run in this process; the second has failed on a tile."""
    from support.node_bench import running

    from lidar_buildings.ros.stage_node import StageNode

    nodes = [StageNode(name, {}, context=context, namespace="site/north") for name in ("first", "second")]
    with running(*nodes):
        nodes[1].summary.failed(f"tile {10**9}: ZeroDivisionError: made to fail")
        yield nodes


@pytest.mark.parametrize("only", [(), ("--namespace", "site/north")])
def test_a_running_graph_has_a_line_for_each_node(command, graph, only):
    spoken = command("top", "--once", "--wait", "60", *only)
    assert (spoken.status, spoken.err) == (0, [])
    assert spoken.out[0] == "graph /site/north"
    assert [line.split()[0] for line in spoken.out[1:4]] == ["node", "first", "second"]
    assert "ERROR" in spoken.out[3]
    assert spoken.out[3].endswith("tile 1000000000: ZeroDivisionError: made to fail")


def test_without_any_graph_that_is_said(command):
    assert "no lidar_buildings graph was found within 0.2 s: " in command.refused("top", "--wait", "0.2")


def test_of_another_namespace_nothing_is_shown(command, graph):
    line = command.refused("top", "--namespace", "elsewhere", "--wait", "1")
    assert "was found in namespace elsewhere within 1 s" in line
