"""Remarks of many files become few lines."""

from lidar_buildings.core.model.remarks import Remark, gathered


def test_of_remarks_alike_the_first_are_told_and_the_others_counted():
    steps = [Remark("coarse_steps", f"{number}.laz: steps of 1 m") for number in range(5)]
    other = Remark("y_up", "heights are in y")
    *told, last = gathered([steps[0], *steps, other])
    assert last == other
    assert [one.text for one in told] == [
        "0.laz: steps of 1 m",
        "1.laz: steps of 1 m",
        "2.laz: steps of 1 m (and 2 more like this)",
    ]
