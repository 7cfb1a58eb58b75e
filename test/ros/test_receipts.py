"""What nodes say of the tiles in their hands, and what the player knows of the nodes by it."""

import pytest
from std_msgs.msg import String

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.ros import receipts
from lidar_buildings.ros.graph_watch import GraphWatch
from lidar_buildings.ros.receipts import READY, TAKEN, Receipt, receipt_message, receipt_of


class Endpoint:
    def __init__(self, node_name, node_namespace="/survey"):
        self.node_name, self.node_namespace = node_name, node_namespace


class View:
    """Stands for a node's view of the graph."""

    def __init__(self, *endpoints):
        self.endpoints = list(endpoints)

    def get_namespace(self):
        return "/survey"

    def get_publishers_info_by_topic(self, topic):
        assert topic == receipts.TOPIC
        return self.endpoints

    def count_publishers(self, topic):
        return len(self.endpoints)


def here(node, life="1"):
    return Receipt(node, f"{receipts._PROCESS}.{life}", READY, 0)


def elsewhere(node, life="1"):
    return Receipt(node, f"other.{node}.{life}", READY, 0)


def test_a_receipt_comes_out_of_its_message_as_it_went_in():
    receipt = Receipt("ground_filter", "a.b", TAKEN, 1_234_567_890_123_456_789)
    assert receipt_of(receipt_message(receipt)) == receipt


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "null", '{"node": "a"}', '{"node":"a","life":"b","state":"c"}', "[" * 9999),
        '{"node":"a","life":"b","state":"c","stamp":1e999}',
        " " * 20_000_001,
    ],
)
def test_what_is_no_receipt_is_refused(text):
    with pytest.raises(MessageError, match="tile_receipt is not understood"):
        receipt_of(String(data=text))


def test_a_node_is_new_at_its_first_word_and_after_a_restart():
    watch = GraphWatch(View())
    assert watch.hear(here("filter"))
    assert not watch.hear(here("filter"))
    assert watch.hear(here("filter", "2"))
    assert not watch.hear(here("filter", "1"))
    assert watch.is_past(here("filter", "1"))
    assert not watch.is_past(here("filter", "2"))


def test_nodes_of_one_process_know_of_each_other_once_all_have_spoken():
    watch = GraphWatch(View(Endpoint("filter"), Endpoint("writer")))
    watch.hear(here("filter"))
    assert not watch.is_settled
    watch.hear(here("writer"))
    assert watch.is_settled


def test_a_node_of_another_process_gets_time_to_find_the_others(clock):
    watch = GraphWatch(View(Endpoint("filter")), clock)
    watch.hear(elsewhere("filter"))
    assert not watch.is_settled
    clock.time += 1.0
    assert watch.is_settled
    watch.hear(elsewhere("filter", "2"))
    assert not watch.is_settled


def test_a_replica_that_is_missing_is_named_until_it_is_there(clock):
    view = View(Endpoint("roof_selector_0"))
    watch = GraphWatch(view, clock)
    assert watch.missing_replicas() == []

    def speaks(number, life=1, n_replicas=2):
        name = f"roof_selector_{number}"
        watch.hear(Receipt(name, f"{name}.{life}", READY, 0, "roof_selector", number, n_replicas))

    speaks(0)
    assert watch.missing_replicas() == ["replica 1 of 2 of roof_selector"]
    view.endpoints.append(Endpoint("roof_selector_1"))
    assert watch.missing_replicas() == ["replica 1 of 2 of roof_selector"]
    speaks(1)
    assert watch.missing_replicas() == []
    del view.endpoints[0]
    assert watch.missing_replicas() == ["replica 0 of 2 of roof_selector"]
    view.endpoints.append(Endpoint("roof_selector_0"))
    for number in range(3):
        speaks(number, 2, 3)
    assert watch.missing_replicas() == ["replica 2 of 3 of roof_selector"]
    for number in range(2):
        speaks(number, 3, 2)
    assert watch.missing_replicas() == []


def test_a_node_whose_name_comes_after_its_publisher_is_there(clock):
    view = View(Endpoint("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_"))
    watch = GraphWatch(view, clock)
    watch.hear(Receipt("roof_selector_0", "a", READY, 0, "roof_selector", 0, 2))
    assert watch.missing_replicas() == [f"replica {number} of 2 of roof_selector" for number in range(2)]
    view.endpoints[:] = [Endpoint("roof_selector_0")]
    clock.time += 1.0
    assert watch.missing_replicas() == ["replica 1 of 2 of roof_selector"]


def test_other_graphs_are_not_waited_for():
    assert GraphWatch(View(Endpoint("filter", "/other"))).is_settled
