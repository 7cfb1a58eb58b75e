from dataclasses import dataclass
from typing import ClassVar

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig, parameter
from lidar_buildings.ros.parameters import NodeParameters, parameter_overrides


@dataclass(frozen=True)
class RoofConfig(StageConfig):
    stage: ClassVar[str] = "roofs"
    max_distance: float = parameter(0.5, "Raising it takes more.", unit="m", within=(0.0, 2.0))
    min_points: int = parameter(3, "Raising it finds fewer.", within=(1, None))
    method: str = parameter("ransac", "How.", choices=("ransac", "growing"))
    is_on: bool = parameter(True, "Whether.", read_only=True)
    input: tuple[str, ...] = parameter((), "Files.")


@dataclass(frozen=True)
class WallConfig(StageConfig):
    stage: ClassVar[str] = "walls"
    max_distance: float = parameter(0.1, "Raising it takes more.", unit="m", within=(0.0, 1.0))
    noise: float = parameter(0.2, "Raising it smooths.", unit="m", within=(0.0, None), advanced=True)


@dataclass(frozen=True)
class RangeConfig(StageConfig):
    stage: ClassVar[str] = "ranges"
    low: int = parameter(1, "Raising it narrows the range.")
    high: int = parameter(5, "Raising it widens the range.")

    def __post_init__(self):
        super().__post_init__()
        if self.low > self.high:
            raise ParameterError(f"ranges.low = {self.low}: must be at most {self.high}")


ONE = {"roofs": RoofConfig}
TWO = {"roofs": RoofConfig, "walls": WallConfig}


@pytest.fixture
def make(context):
    nodes = []

    def make_node(configs, **overrides):
        values = [Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()]
        node = Node(
            "tester",
            context=context,
            parameter_overrides=values,
            automatically_declare_parameters_from_overrides=True,
        )
        nodes.append(node)
        return node, NodeParameters(node, configs)

    yield make_node
    for node in nodes:
        node.destroy_node()


def test_defaults_are_those_of_the_config(make):
    node, parameters = make(ONE)
    assert parameters[RoofConfig] == RoofConfig()
    assert node.get_parameter("max_distance").value == 0.5
    assert node.get_parameter("input").value == [""]


def test_a_node_with_several_stages_puts_the_stage_before_the_name(make):
    node, parameters = make(TWO, walls__max_distance=0.2)
    assert parameters[WallConfig].max_distance == 0.2
    assert parameters[RoofConfig].max_distance == 0.5
    assert node.has_parameter("roofs.max_distance")


def test_advanced_parameters_have_a_name_that_says_so(make):
    one, _ = make({"walls": WallConfig})
    several, _ = make(TWO)
    assert one.get_parameter("advanced.noise").value == 0.2
    assert several.get_parameter("walls.advanced.noise").value == 0.2
    assert not one.has_parameter("noise")


@pytest.mark.parametrize("name", ["walls.noise", "walls.advanced.noise"])
def test_start_values_of_advanced_parameters_have_two_spellings(make, name):
    node, parameters = make(TWO, **{name: 0.4})
    assert parameters[WallConfig].noise == node.get_parameter("walls.advanced.noise").value == 0.4
    assert parameters.as_dict()["walls"]["noise"] == 0.4


@pytest.mark.parametrize("name", ["walls.noize", "walls.advanced.noize"])
def test_a_wrong_name_suggests_the_full_one(make, name):
    with pytest.raises(ParameterError, match=r"\(did you mean walls\.advanced\.noise\?\)"):
        make(TWO, **{name: 0.4})


def test_start_values_are_taken_and_whole_numbers_will_do_for_floats(make):
    _, parameters = make(ONE, max_distance=2, input=["a.laz", "b.laz"])
    assert parameters[RoofConfig].max_distance == 2.0
    assert parameters[RoofConfig].input == ("a.laz", "b.laz")


def test_descriptors_tell_description_unit_range_and_what_is_fixed(make):
    node, _ = make(ONE)
    distance = node.describe_parameter("max_distance")
    assert distance.description == "Raising it takes more. [m]"
    assert (distance.floating_point_range[0].from_value, distance.floating_point_range[0].to_value) == (
        0.0,
        2.0,
    )
    points = node.describe_parameter("min_points").integer_range[0]
    assert (points.from_value, points.to_value) == (1, 2**63 - 1)
    assert node.describe_parameter("method").additional_constraints == "one of ransac, growing"
    assert node.describe_parameter("is_on").read_only


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        ({"max_distance": 3.0}, r"tester.max_distance = 3.0: must be within 0 to 2 \[m\]"),
        ({"min_points": 0}, "tester.min_points = 0: must be at least 1"),
        ({"min_points": 1.5}, "tester.min_points = 1.5: must be of type int"),
        ({"method": "magic"}, "tester.method = 'magic': must be one of ransac, growing"),
        ({"input": "a.laz"}, "tester.input = 'a.laz': must be a list of texts"),
        ({"max_distanse": 1.0}, r"tester.max_distanse: .* \(did you mean max_distance\?\)"),
        ({"qqq": 1.0}, r"tester.qqq: there is no such parameter \(there are max_distance, min_points"),
    ],
)
def test_a_wrong_start_value_or_name_is_one_clear_line(make, overrides, line):
    with pytest.raises(ParameterError, match=line) as caught:
        make(ONE, **overrides)
    assert "\n" not in str(caught.value)


def test_a_change_at_run_time_counts_from_then_on(make):
    node, parameters = make(TWO)
    results = node.set_parameters([Parameter("roofs.max_distance", value=1.5)])
    assert results[0].successful
    assert parameters[RoofConfig].max_distance == 1.5


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("max_distance", 5.0, "max_distance"),
        ("method", "magic", "tester.method = 'magic': must be one of ransac, growing"),
        ("is_on", False, "read-only"),
    ],
)
def test_a_change_that_is_not_allowed_is_refused_with_its_reason(make, name, value, reason):
    node, parameters = make(ONE)
    result = node.set_parameters([Parameter(name, value=value)])[0]
    assert not result.successful
    assert reason in result.reason
    assert parameters[RoofConfig] == RoofConfig()


def test_changes_that_do_not_go_together_are_refused_and_change_nothing(make):
    node, parameters = make({"ranges": RangeConfig})
    result = node.set_parameters_atomically([Parameter("low", value=7)])
    assert not result.successful
    assert "ranges.low = 7" in result.reason
    assert node.get_parameter("low").value == parameters[RangeConfig].low == 1
    both = [Parameter("low", value=7), Parameter("high", value=9)]
    assert node.set_parameters_atomically(both).successful
    assert parameters[RangeConfig] == RangeConfig(low=7, high=9)
    assert parameters.as_dict() == {"ranges": {"low": 7, "high": 9}}


def test_overrides_of_a_node_are_made_from_settings_by_stage(make):
    settings = {"walls": {"max_distance": 0.3, "noise": 0.1}, "roofs": {"input": ()}, "other": {"x": 1}}
    made = {one.name: one.value for one in parameter_overrides(TWO, settings)}
    assert made == {"walls.max_distance": 0.3, "walls.advanced.noise": 0.1, "roofs.input": [""]}
