"""What the table of nodes, the configs, the parameter file and the pages say is what the nodes do."""

import json
import re
from importlib.util import find_spec

import pytest
import yaml
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from support.cloud_files import random_cloud
from support.source_tree import ROOT

from bench.pages import node_reference as reference
from lidar_buildings.commands.settings import shared_file
from lidar_buildings.core.model.parameters import flat_names, parameter_names, spec_of
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.nodes import table
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.nodes.graph import node_class
from lidar_buildings.nodes.table import OF_EVERY_NODE
from lidar_buildings.pipeline.config import STAGE_CONFIGS
from lidar_buildings.ros import qos
from lidar_buildings.ros.depths import MAP_DEPTH
from lidar_buildings.ros.parameters import ros_value

CARDS = {card.name: card for card in table.NODE_TABLE}
#: Parameters that `start` gives.
GIVEN = {"input", "output", "advanced.output", "advanced.publish_clock", "footprints.file"}
GIVEN |= {"publish_dtm", "advanced.publish_dtm", "flow_control.advanced.publish_tile_done"}

#: doc/graph.md: node → (subscribes, publishes).
DESIGN = {
    "tile_player": ({"tile_done"}, {"points", "map_origin", "/clock"}),
    "scan_assembler": ({"scan", "odometry"}, {"points", "map_origin"}),
    "ground_filter": ({"points"}, {"ground_points", "dtm"}),
    "roof_selector": ({"ground_points"}, {"classified_points", "roof_points", "street_points"}),
    "edge_labeller": ({"roof_points"}, {"edge_points"}),
    "building_tracer": ({"edge_points"}, {"building_points", "traced_outlines"}),
    "outline_regulariser": ({"traced_outlines"}, {"outlines"}),
    "facade_finder": (
        {"street_points", "outlines", "road_points"},
        {"facades", "facade_records", "facade_markers", "wall_map"},
    ),
    "plane_fitter": ({"building_points"}, {"plane_points"}),
    "model_builder": (
        {"plane_points", "outlines"},
        {"roof_faces", "city_model", "building_markers", "tile_done"},
    ),
    "model_writer": (
        {"classified_points", "plane_points", "traced_outlines", "outlines", "city_model"},
        {"tile_done"},
    ),
    "recorder": ({"points", "map_origin", "outlines", "city_model", "diagnostics"}, set()),
}


@pytest.fixture
def start(context, tmp_path):
    """Make a node with every optional topic switched on."""
    cloud = tmp_path / "cloud.laz"
    random_cloud(50).write(cloud)
    footprints = tmp_path / "footprints.gpkg"
    footprints.touch()
    given = {
        "building_tracer": {"footprints.file": str(footprints)},
        "tile_player": {"input": [str(cloud)], "publish_clock": True},
        "ground_filter": {"publish_dtm": True},
        "model_builder": {"flow_control.publish_tile_done": True},
        "model_writer": {"output": str(tmp_path / "out")},  # live
        "recorder": {"advanced.output": str(tmp_path / "bag")},
    }
    started = []

    def make(name, **overrides):
        values = given.get(name, {}) | overrides
        parameters = [Parameter(key, value=value) for key, value in values.items()]
        node = node_class(name)(context=context, namespace="contract", parameter_overrides=parameters)
        started.append(node)
        return node

    yield make
    for node in started:
        node.destroy_node()


def endpoints(node, getter):
    infos = set()
    for topic, _ in node.get_topic_names_and_types():
        for info in getter(topic):
            if info.node_name == node.get_name():
                infos.add((topic, info.topic_type.replace("/msg/", "/"), is_latched(info.qos_profile)))
    return {info for info in infos if info[0] not in ("/rosout", "/parameter_events")}


def is_latched(profile: QoSProfile):
    is_sensor = profile.reliability == qos.SENSOR.reliability
    assert profile.reliability == ReliabilityPolicy.RELIABLE or is_sensor
    return profile.durability == DurabilityPolicy.TRANSIENT_LOCAL


def promised(topics, profile="qos"):
    return {
        (
            topic.name if topic.name.startswith("/") else f"/contract/{topic.name}",
            topic.type,
            is_latched(getattr(qos, getattr(topic, profile))),
        )
        for topic in topics
        if find_spec(topic.type.split("/")[0])  # tf2_msgs is no wheel
    }


@pytest.mark.graph
@pytest.mark.parametrize("name", CARDS)
def test_every_node_has_the_topics_types_and_durabilities_of_the_table(start, name):
    node = start(name)
    assert endpoints(node, node.get_publishers_info_by_topic) == promised(
        {*CARDS[name].publishes, *OF_EVERY_NODE}
    )
    assert endpoints(node, node.get_subscriptions_info_by_topic) == promised(
        CARDS[name].subscribes,
        "qos" if name == "recorder" else "listener_qos",  # a recorder is late, too
    )


@pytest.mark.graph
@pytest.mark.parametrize("name", [name for name in CARDS if reference.services_of(name)])
def test_every_node_has_the_services_of_the_page(start, name):
    own = {
        (service, kinds[0].replace("/srv/", "/"))
        for service, kinds in start(name).get_service_names_and_types()
        if kinds[0].startswith("std_srvs")
    }
    assert own == {
        (service.replace("~", f"/contract/{name}"), "std_srvs/Trigger")
        for service in reference.services_of(name)
    }


def test_the_table_holds_all_that_the_design_names():
    assert CARDS.keys() == DESIGN.keys() == NODE_CONFIGS.keys()
    for name, (subscribes, publishes) in DESIGN.items():
        assert subscribes <= {topic.name for topic in CARDS[name].subscribes}, name
        assert publishes <= {topic.name for topic in CARDS[name].publishes}, name


def test_every_stage_has_its_node():
    found = {stage: config for configs in NODE_CONFIGS.values() for stage, config in configs.items()}
    # a node may have parameters of its own beside its stage's
    assert all(issubclass(found[stage], config) for stage, config in STAGE_CONFIGS.items())
    assert all(config.stage == stage for stage, config in found.items())


@pytest.mark.parametrize(
    ("stage", "clouds"),
    [
        ("ground_filter", ["ground_points"]),
        ("roof_selection", ["classified_points"]),
        ("boundary_tracing", ["classified_points", "building_points"]),
        ("building_model", ["classified_points", "plane_points"]),
    ],
)
def test_the_writer_takes_all_points_first_and_then_the_roofs(stage, clouds):
    topics = list(table.writer_topics(stage))
    assert topics[: len(clouds)] == clouds
    assert not any("points" in name for name in topics[len(clouds) :])


@pytest.mark.parametrize("stage", STAGES)
def test_a_shorter_run_has_a_listener_for_every_topic_that_it_must_wait_for(stage):
    nodes = table.nodes_until(stage)
    assert nodes[0] == "tile_player"
    assert nodes[-1] == "model_writer"
    published = {topic.name for name in nodes for topic in CARDS[name].publishes}
    assert set(table.topics_until(stage)) <= published
    heard = {
        topic.name
        for name in nodes[1:-1]
        for topic in CARDS[name].subscribes
        if topic.name not in table.ON_REQUEST.get(name, ())
    }
    assert set(table.topics_until(stage)) == {*heard, *table.writer_topics(stage)}
    assert {*table.writer_topics(stage)} <= published


def declared(configs):
    """Parameter name → (value as ROS has it, config field)."""
    return {name: (ros_value(one.default), one) for name, (_, one) in parameter_names(configs).items()}


@pytest.mark.graph
@pytest.mark.parametrize("name", CARDS)
def test_declared_parameters_have_the_defaults_and_ranges_of_the_configs(start, name):
    node = start(name)
    for parameter, (value, one) in declared(NODE_CONFIGS[name]).items():
        assert parameter in GIVEN or node.get_parameter(parameter).value == value
        descriptor = node.describe_parameter(parameter)
        assert descriptor.description.startswith(spec_of(one).description)
        assert descriptor.read_only == spec_of(one).read_only


def parameters_of_the_file():
    """(node, parameter name) → value in the parameter file that we ship."""
    content = yaml.safe_load(shared_file("pipeline.param.yaml").read_text(encoding="utf-8"))
    return {
        (key.removeprefix("/**/"), name): value
        for key, body in content.items()
        for name, value in flat_names(body["ros__parameters"])
    }


def test_the_parameter_file_has_the_defaults_of_all_that_is_not_advanced_once_per_stage():
    found = parameters_of_the_file()
    stages = set()
    for (node, name), value in found.items():
        default, one = declared(NODE_CONFIGS[node])[name]
        assert (value, type(value)) == (default, type(default))
        assert not spec_of(one).advanced
        stages.add((parameter_names(NODE_CONFIGS[node])[name][0], one.name))
    assert len(stages) == len(found)
    assert stages == {
        (stage, one.name)
        for configs in NODE_CONFIGS.values()
        for stage, one in parameter_names(configs).values()
        if not spec_of(one).advanced
    }


def test_the_generated_files_are_up_to_date():
    assert reference.main(["--check"]) == 0


@pytest.mark.graph
@pytest.mark.parametrize("namespace", ["", "left/inner"])
def test_the_parameter_file_is_read_by_a_node_in_any_namespace(context, tmp_path, namespace):
    text = reference.parameter_yaml()
    line = next(row for row in text.splitlines() if row.strip().startswith("min_"))
    name, default = line.strip().split(": ")
    changed = tmp_path / "changed.yaml"
    kind = type(yaml.safe_load(default))
    changed.write_text(text.replace(line, line.replace(default, str(kind(float(default) * 1.5)))))
    node_name = next(n for n, of in NODE_CONFIGS.items() if name in declared(of))
    arguments = ["--ros-args", "--params-file", str(changed)]
    node = node_class(node_name)(context=context, namespace=namespace, cli_args=arguments)
    assert node.get_parameter(name).value == kind(float(default) * 1.5)
    node.destroy_node()


def test_rviz_shows_topics_that_nodes_publish_in_messages_that_it_can_draw():
    displays = yaml.safe_load((ROOT / "config" / "lidar_buildings.rviz").read_text())["Visualization Manager"]
    shown = {
        one["Topic"]["Value"]: one["Class"].split("/")[1] for one in displays["Displays"] if "Topic" in one
    }
    types = {topic.name: topic.type.split("/")[1] for card in table.NODE_TABLE for topic in card.publishes}
    assert shown
    assert shown == {name: types.get(name) for name in shown}
    (markers,) = [one["Topic"] for one in displays["Displays"] if one["Name"] == "building_markers"]
    assert (markers["Durability Policy"], markers["Depth"]) == ("Transient Local", MAP_DEPTH)


#: Where the layout's plots find a number that a node tells.
PATH = re.compile(r'/diagnostics\.status\[:\]\{name=="(\w+): summary"\}\.values\[:\]\{key=="(\w+)"\}\.value')


def test_foxglove_shows_topics_that_nodes_publish_and_numbers_that_they_tell(start):
    layout = json.loads((ROOT / "config" / "foxglove_layout.json").read_text())
    panels = layout["configById"]
    assert set(re.findall(r'"(\w+!\w+)"', json.dumps(layout["layout"]))) == set(panels)
    published = {f"/{topic.name}": topic.type for card in table.NODE_TABLE for topic in card.publishes}
    shown = panels["3D!buildings"]["topics"]
    drawn = {"sensor_msgs/PointCloud2", "visualization_msgs/MarkerArray"}
    assert {published.get(name) for name in shown} == drawn
    assert panels["DiagnosticSummary!nodes"]["topicToRender"] == "/diagnostics"
    lines = [line["value"] for one in panels.values() for line in one.get("paths", ())]
    plotted = [PATH.fullmatch(line).groups() for line in lines]
    told = {node: {"buildings", *start(node).summary.state()[2]} for node in dict(plotted)}
    assert {node for node, _ in plotted} >= {card.name for card in table.NODE_TABLE} - {"recorder"}
    assert [(node, key) for node, key in plotted if key not in told[node]] == []


def test_what_names_files_and_folders_is_fixed_when_a_node_starts():
    changeable = {
        one.name
        for configs in NODE_CONFIGS.values()
        for _, one in parameter_names(configs).values()
        if isinstance(one.default, str | tuple) and not spec_of(one).choices and not spec_of(one).read_only
    }
    assert not changeable
