"""What a tile's later revision has no more."""

from lidar_buildings.core.model import withdrawals
from lidar_buildings.core.model.withdrawals import Withdrawals

TILE, OTHER = 5_000_000, 6_000_000


def test_what_a_later_revision_lacks_is_withdrawn_once():
    gone = Withdrawals()
    assert gone.of(TILE, [3, 1, 2]) == []
    assert gone.of(TILE + 1, [2, 7]) == [1, 3]
    assert gone.of(TILE + 2, [2, 7]) == []
    assert gone.of(TILE + 3, []) == [2, 7]


def test_tiles_do_not_withdraw_each_others_buildings():
    gone = Withdrawals()
    gone.of(TILE, ["a"])
    assert gone.of(OTHER, ["b"]) == []
    assert gone.of(OTHER + 1, []) == ["b"]
    assert gone.of(TILE + 1, []) == ["a"]


def test_a_building_that_has_gone_over_to_another_tile_stays():
    gone = Withdrawals()
    gone.of(TILE, [1])
    gone.of(OTHER, [1])
    assert gone.of(TILE + 1, []) == []
    assert gone.of(OTHER + 1, []) == [1]


def test_an_earlier_revision_that_comes_late_changes_nothing():
    gone = Withdrawals()
    gone.of(TILE + 1, [1, 2])
    assert gone.of(TILE, [1]) == []
    assert gone.of(TILE + 2, [1]) == [2]


def test_the_tiles_that_were_published_longest_ago_are_forgotten(monkeypatch):
    monkeypatch.setattr(withdrawals, "_MAX_BUILDINGS", 3)
    gone = Withdrawals()
    gone.of(TILE, [1, 2])
    gone.of(OTHER, [3])
    gone.of(TILE + 1, [1, 2])
    gone.of(7_000_000, [4])
    assert gone.of(OTHER + 1, []) == []
    assert gone.of(TILE + 2, []) == [1, 2]
