"""The fuzzer in a short form: whatever comes, only the documented errors."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.fuzz import run
from bench.fuzz.targets import TARGETS
from lidar_buildings.core.model.errors import LidarBuildingsError

pytest.importorskip("rclpy")


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=150)
@given(seed=st.integers(0, 2**63 - 1))
def test_whatever_comes_only_the_documented_errors_are_raised(name, seed):
    target, _ = TARGETS[name]
    with suppress(LidarBuildingsError):
        target(np.random.default_rng(seed))


def test_a_damaged_bag_with_a_topic_of_no_type_is_refused():
    with pytest.raises(LidarBuildingsError, match="contains no sensor_msgs/msg/PointCloud2; its topics:"):
        TARGETS["bags"][0](np.random.default_rng((5_000_000, 794)))


def test_what_fails_is_printed_with_its_seed(monkeypatch, capsys):
    outcomes = iter(["accepted", ZeroDivisionError("by 0"), LidarBuildingsError("is 1.5 not 2"), "accepted"])

    def target(_):
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    monkeypatch.setattr(run, "TARGETS", {"one": (target, 1.0)})
    assert run.main(["--cases", "3"]) == 1
    printed = capsys.readouterr().out
    assert "FAILED one --seed 0, case 0" in printed
    assert "one: 3 cases" in printed
    assert "1  LidarBuildingsError: is # not #" in printed


def test_a_case_that_takes_too_long_fails(monkeypatch):
    def target(_):
        while True:
            pass

    monkeypatch.setattr(run, "LONGEST", 0.01)
    with run.Limits() as limits, pytest.raises(TimeoutError), limits.of_a_case():
        target(None)
