"""The rule of lost tiles, also in random graphs that lose messages and whose nodes die, stop and return."""

import random

import numpy as np
import pytest

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.node_state import FAILED, IN_HAND, PASSED_ON, WAITING, NodeState, TileState, state_of
from lidar_buildings.ros.tile_ledger import TileLedger

STAMP, OTHER = 1_000_000, 2_000_000


def tile(stamp=STAMP, n=1, **members):
    return PointTile(np.zeros((n, 3)), stamp=stamp, **members)


class Graph:
    """Nodes that say what they have, and the source's ledger."""

    def __init__(self, *nodes, limit=2, **given):
        self.time = 0.0
        self.ledger = TileLedger(limit, 1.0, given.pop("max_attempts", 2), lambda: self.time)
        self.numbers = {}
        self.lives = {node: f"{node} first" for node in nodes}
        self.tiles = {node: {} for node in nodes}
        for node in nodes:
            self.say(node)

    def say(self, node, **said):
        self.numbers[node] = self.numbers.get(node, 0) + 1
        self.ledger.hear(NodeState(node, self.lives[node], self.numbers[node], self.tiles[node], **said))

    def set(self, node, status, stamp=STAMP, missing=(), reason=""):
        self.tiles[node] = {**self.tiles[node], stamp: TileState(status, missing, reason)}
        self.say(node)

    def restart(self, node):
        self.lives[node] += "'"
        self.numbers[node], self.tiles[node] = 0, {}
        self.say(node)

    def wait(self, seconds, silent=()):
        """Let time pass in which nodes speak; return what is lost meanwhile."""
        lost = []
        for _ in range(round(seconds / 0.2)):
            self.time += 0.2
            for node in self.tiles:
                if node not in silent:
                    self.say(node)
            lost += [flight.tile.stamp for flight in self.ledger.lost()]
        return lost


@pytest.fixture
def graph():
    made = Graph("filter", "builder")
    made.ledger.sent(tile())
    return made


def test_a_tile_that_no_node_has_is_lost_after_a_second_and_told_once(graph):
    assert graph.wait(0.8) == []
    assert graph.wait(0.6) == [STAMP]
    assert graph.wait(1.6) == [], "it was sent again, and is waited for longer"
    assert graph.wait(2.0) == [STAMP]


def test_a_large_tile_has_a_second_more_for_each_50_megabytes():
    graph = Graph("filter")
    graph.ledger.sent(tile(n=3_125_000))  # 100 MB
    assert graph.wait(2.8) == []
    assert graph.wait(0.6) == [STAMP]


def test_a_tile_in_hand_is_never_lost_but_one_that_was_passed_on_and_arrived_nowhere(graph):
    graph.set("filter", IN_HAND)
    assert graph.wait(1000.0) == []
    graph.set("filter", PASSED_ON)
    assert graph.wait(0.8) == []
    assert graph.wait(0.6) == [STAMP]


def test_a_part_that_is_waited_for_is_lost_when_nobody_has_the_tile_in_hand(graph):
    graph.set("builder", WAITING, missing=("outlines",))
    graph.set("filter", IN_HAND)
    assert graph.wait(100.0) == []
    graph.set("filter", PASSED_ON)
    assert graph.wait(1.4) == [STAMP]


def test_silence_proves_nothing(graph):
    assert graph.wait(1000.0, silent=("builder",)) == []
    assert graph.wait(0.2) == []
    assert graph.wait(0.6) == [STAMP]


def test_a_node_that_left_the_graph_is_not_waited_for(graph):
    graph.set("builder", IN_HAND)
    assert graph.wait(100.0, silent=("builder",)) == []
    graph.ledger.see({"filter"})
    assert graph.wait(1.6, silent=("builder",)) == [STAMP]


def test_a_node_that_returns_with_the_same_life_has_its_tiles_and_it_was_no_attempt(graph):
    graph.set("builder", IN_HAND)
    graph.ledger.see({"filter"})
    graph.ledger.see({"filter", "builder"})
    assert graph.wait(100.0) == []
    assert graph.ledger.given_up() == {}


def test_only_deaths_with_the_tile_in_hand_count_as_attempts(graph):
    for _ in range(5):
        graph.restart("builder")
        graph.wait(10.0)
    assert graph.ledger.given_up() == {}
    for attempt in range(2):
        assert graph.ledger.given_up() == {}
        graph.set("builder", IN_HAND)
        graph.restart("builder")
        assert graph.wait(2.0) == [STAMP] or attempt
    assert graph.ledger.given_up() == {STAMP: "2 nodes ended while they worked on it"}
    assert len(graph.ledger) == 0


def test_what_a_node_cannot_handle_is_given_up_with_its_reason(graph):
    graph.set("filter", FAILED, reason="it is flat")
    assert graph.ledger.given_up() == {STAMP: "it is flat"}
    assert graph.ledger.gauges()["tiles_given_up"] == 1


def test_states_of_an_earlier_life_or_number_say_nothing(graph):
    old = NodeState("builder", "builder first", 9, {STAMP: TileState(IN_HAND)})
    graph.restart("builder")
    graph.ledger.hear(old)
    graph.numbers["filter"] = 50
    graph.say("filter")
    graph.ledger.hear(NodeState("filter", "filter first", 7, {STAMP: TileState(IN_HAND)}))
    assert graph.wait(2.0) == [STAMP]


def test_a_tile_that_is_too_small_is_asked_for_until_there_is_no_more_of_it(graph):
    graph.ledger.sent(tile(bounds=(0.0, 0.0, 9.0, 9.0)))
    graph.set("filter", WAITING, missing=("east",))
    ((asked, sides),) = graph.ledger.wanted()
    assert (asked.stamp, sides) == (STAMP, Sides(east=True))
    assert graph.wait(100.0) == [], "it is being read"
    graph.ledger.sent(tile(bounds=(0.0, 0.0, np.inf, 9.0)))
    assert list(graph.ledger.wanted()) == []
    assert graph.wait(1.6) == [STAMP], "that this is all did not arrive"


def test_a_larger_revision_takes_the_place_of_the_one_before(graph):
    graph.set("filter", IN_HAND)
    graph.ledger.sent(tile(STAMP + 1))
    assert len(graph.ledger) == 1
    assert not graph.ledger.done(STAMP)
    assert graph.wait(1.6) == [STAMP + 1], "the node has another revision in hand"
    assert graph.ledger.done(STAMP + 1)
    assert len(graph.ledger) == 0


def test_credits_are_those_of_the_limit_unless_tiles_are_small_or_there_is_none():
    ledger = TileLedger(2, 1.0, 4)
    for number in range(1, 4):
        assert ledger.has_room
        ledger.sent(tile(number * 1_000_000, n=140_000))
    assert not ledger.has_room
    single = TileLedger(1, 1.0, 4)
    single.sent(tile())
    assert not single.has_room
    ledger = TileLedger(0, 1.0, 4)
    ledger.sent(tile())
    assert (ledger.has_room, len(ledger)) == (True, 0)


def test_the_source_waits_until_nodes_have_spoken_and_know_of_each_other():
    graph = Graph("filter")
    listeners = {"/points": 1, "/ground": 2}.__getitem__
    graph.say("filter", matched={"/ground": 1})
    assert not graph.ledger.is_settled({"filter"}, listeners)
    graph.say("filter", matched={"/ground": 2}, n_done=1)
    assert not graph.ledger.is_settled({"filter"}, listeners), "done tiles have not been heard of"
    assert graph.ledger.done(STAMP)
    assert graph.ledger.is_settled({"filter"}, listeners)
    assert not graph.ledger.is_settled({"filter", "builder"}, listeners)
    graph.say("filter", matched={"/ground": 1})
    graph.time += 5.0
    assert graph.ledger.is_settled({"filter"}, listeners), "they do not find each other"


def test_replicas_that_are_not_there_are_named():
    graph = Graph("a")
    graph.say("a", kind="roof_selector", replica=1, replicas=3)
    assert graph.ledger.missing_replicas() == [f"replica {k} of 3 of roof_selector" for k in (0, 2)]


def test_a_state_is_the_same_after_its_way_as_json():
    state = NodeState(
        "a", "life", 7, {5: TileState(WAITING, ("outlines",), "")}, True, "a", 1, 2, 3, {"/t": 4}
    )
    assert state_of(state.message()) == state


# random graphs

#: Node → the nodes that it sends to; the last one joins two parts and reports tiles as done.
CHAIN = {"a": ("b",), "b": ("c", "d"), "c": ("e",), "d": ("e",), "e": ()}
STEP = 0.1


class Node:
    def __init__(self, name, life):
        self.name, self.life, self.sequence = name, life, 0
        self.tiles, self.parts, self.work, self.inbox = {}, {}, {}, []
        self.frozen_until = self.dead_until = self.stopped = 0.0


class World:
    """Nodes, messages on their way, and a source that follows its ledger."""

    def __init__(self, seed, n_tiles=6, loss=0.1, trouble=0.004):
        self.chance, self.time, self.lives = random.Random(seed), 0.0, 0
        self.loss, self.trouble = loss, trouble
        self.ledger = TileLedger(2, 1.0, 50, lambda: self.time)
        self.nodes = {name: self.made(name) for name in CHAIN}
        self.todo = [(number + 1) * 1_000_000 for number in range(n_tiles)]
        self.done, self.messages, self.states, self.n_resent = set(), [], [], 0

    def made(self, name):
        self.lives += 1
        return Node(name, f"{name}{self.lives}")

    def run(self, seconds):
        while self.todo or len(self.ledger):
            self.time += STEP
            assert self.time < seconds, (self.time, len(self.ledger), self.todo)
            for name in CHAIN:
                self.step(name)
            self.deliver()
            self.send()

    def step(self, name):
        node, chance = self.nodes[name], self.chance
        if node.dead_until > self.time:
            return
        if node.dead_until:
            self.nodes[name] = node = self.made(name)
        if node.frozen_until > self.time:
            return
        if self.todo and chance.random() < self.trouble:
            node.stopped = self.time
            if chance.random() < 0.5:
                node.dead_until = self.time + chance.choice([0.2, 3.0, 12.0])
                return
            node.frozen_until = self.time + chance.choice([0.5, 5.0, 30.0])
            return
        for sender, stamp in node.inbox:
            self.take(node, sender, stamp)
        node.inbox.clear()
        for stamp in [stamp for stamp, until in node.work.items() if until <= self.time]:
            del node.work[stamp]
            self.finish(node, stamp)
        if round(self.time / STEP) % 4 == sorted(CHAIN).index(name) % 4:
            self.publish(node)

    def take(self, node, sender, stamp):
        if stamp in node.work or stamp in self.done:
            return
        parts = node.parts.setdefault(stamp, set())
        parts.add(sender)
        missing = {one for one, targets in CHAIN.items() if node.name in targets} - parts
        if missing:
            node.tiles[stamp] = TileState(WAITING, tuple(sorted(missing)))
        else:
            del node.parts[stamp]
            node.work[stamp] = self.time + self.chance.choice([0.1, 0.5, 2.0, 15.0])
            node.tiles[stamp] = TileState(IN_HAND)
        self.publish(node)

    def finish(self, node, stamp):
        for target in CHAIN[node.name]:
            self.post(node.name, target, stamp)
        if not CHAIN[node.name]:
            self.done.add(stamp)
            self.messages.append((self.time + 0.1, "source", "e", stamp))
        node.tiles[stamp] = TileState(PASSED_ON)
        self.publish(node)

    def publish(self, node):
        node.sequence += 1
        state = NodeState(node.name, node.life, node.sequence, dict(node.tiles))
        arrival = max(
            [self.time + self.chance.uniform(0.0, 0.3)] + [t for t, s in self.states if s.node == node.name]
        )
        self.states.append((arrival, state))

    def post(self, sender, target, stamp):
        if self.chance.random() >= self.loss:
            self.messages.append((self.time + self.chance.uniform(0.0, 0.4), target, sender, stamp))

    def deliver(self):
        due = [one for one in self.messages if one[0] <= self.time]
        self.messages = [one for one in self.messages if one[0] > self.time]
        for _, target, sender, stamp in due:
            if target == "source":
                self.ledger.done(stamp)
                for node in self.nodes.values():
                    node.tiles.pop(stamp, None)
            elif self.nodes[target].dead_until <= self.time:
                self.nodes[target].inbox.append((sender, stamp))
        for arrival, state in self.states:
            if arrival <= self.time:
                self.ledger.hear(state)
        self.states = [one for one in self.states if one[0] > self.time]

    def seen(self):
        """Nodes that are in the graph: dead and stopped ones leave it after ten seconds."""
        return {
            name
            for name, node in self.nodes.items()
            if max(node.frozen_until, node.dead_until) <= self.time or self.time - node.stopped < 10.0
        }

    def send(self):
        self.ledger.see(self.seen())
        is_settled = self.ledger.is_settled(self.seen(), lambda topic: 0)
        for flight in self.ledger.lost() if is_settled else ():
            stamp = flight.tile.stamp
            assert not self.is_under_way(stamp), f"tile {stamp} is not lost at {self.time}"
            self.n_resent += 1
            self.post("source", "a", stamp)
        while self.todo and self.ledger.has_room and len(self.ledger) < 2:
            stamp = self.todo.pop(0)
            self.ledger.sent(tile(stamp))
            self.messages.append((self.time + 0.1, "a", "source", stamp))

    def is_under_way(self, stamp):
        there = self.seen()
        alive = [node for name, node in self.nodes.items() if name in there and node.dead_until <= self.time]
        has_it = any(stamp in node.work or stamp in [one for _, one in node.inbox] for node in alive)
        return has_it or any(one == stamp and to in there for _, to, _, one in self.messages)


@pytest.mark.parametrize("seed", range(150))
def test_whatever_happens_every_tile_is_done_and_none_is_sent_that_was_not_lost(seed):
    world = World(seed, loss=seed % 3 * 0.1, trouble=seed % 5 * 0.004)
    world.run(20_000.0)
    assert len(world.done) == 6
    assert not world.ledger.failed
    if not (seed % 3 or seed % 5):
        assert world.n_resent == 0
