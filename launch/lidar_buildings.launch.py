# SPDX-License-Identifier: Apache-2.0
"""The whole graph, every node a process of its own."""

import json
from functools import partial
from pathlib import Path
from socket import gethostname

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, TimerAction
from launch.conditions import IfCondition
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from lidar_buildings.commands.placement import nodes_of, replica_name, replicas_of, share_parameters
from lidar_buildings.commands.settings import PRESETS, preset_file
from lidar_buildings.core.model.parameters import parameter_names, spellings
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.nodes.graph import run_settings
from lidar_buildings.nodes.table import SOURCES, nodes_until
from lidar_buildings.ros.depths import MOST_TILES

PACKAGE = "lidar_buildings"
#: Exit statuses of nodes: wrong parameters; all done, and all but tiles that failed.
WRONG_USE, FINISHED = 2, (0, 3)
#: A node that died is started again after this [s].
RESPAWN_DELAY = 1.0
DEFAULTS = "pipeline.param.yaml"
SHARED = PathJoinSubstitution([FindPackageShare(PACKAGE), "config"])
#: Arguments that, where given, win over the parameter file.
_OF_BOTH = {
    "tile_size": float,
    "max_tiles_in_flight": int,
    "tile_timeout": float,
    "mounting": str,
    "georeferenced": lambda word: word.lower() == "true",
}
_OF_BAGS = {"topic": str, "odometry": str, "start": float, "duration": float}
SOURCE_ARGUMENTS = {"tile_player": _OF_BOTH | _OF_BAGS | {"rate": float}, "scan_assembler": _OF_BOTH}
#: Topics of a feed that may have other names.
FEED_TOPICS = ("scan", "odometry", "fix")

ARGUMENTS = (
    DeclareLaunchArgument(
        "source",
        default_value=SOURCES[0],
        choices=SOURCES,
        description="Where tiles come from: tile_player plays files, scan_assembler listens to a scanner.",
    ),
    DeclareLaunchArgument(
        "input",
        default_value="",
        description="LAS, LAZ or COPC file, folder or glob, bag; several joined by ':'. None of a live feed.",
    ),
    DeclareLaunchArgument("scan", default_value="scan", description="Topic of the scans of a live feed."),
    DeclareLaunchArgument(
        "odometry",
        default_value="",
        description="Topic of the poses; empty: odometry of a live feed, the only one of a bag.",
    ),
    DeclareLaunchArgument("fix", default_value="fix", description="Topic of a live feed's NavSatFix."),
    DeclareLaunchArgument("topic", default_value="", description="Topic of a bag's scans, if several."),
    DeclareLaunchArgument("start", default_value="", description="Begin so late in a bag [s]."),
    DeclareLaunchArgument("duration", default_value="", description="Read so much of a bag [s]."),
    DeclareLaunchArgument(
        "georeferenced", default_value="", description="true: scans are in the map already, without poses."
    ),
    DeclareLaunchArgument(
        "mounting",
        default_value="",
        description="Where the scanner is fixed in the frame of the poses: x,y,z,roll,pitch,yaw [m, deg].",
    ),
    DeclareLaunchArgument(
        "output",
        default_value="",
        description="Folder for the results; empty writes no files, to look at the topics only.",
    ),
    DeclareLaunchArgument(
        "overwrite", default_value="false", description="Whether to replace earlier results in the folder."
    ),
    DeclareLaunchArgument(
        "params_file",
        default_value=PathJoinSubstitution([SHARED, DEFAULTS]),
        description="Parameters of all nodes.",
    ),
    DeclareLaunchArgument(
        "preset",
        default_value="",
        choices=("", *PRESETS),
        description="The whole chain as a paper has it; params_file wins where it is given.",
    ),
    DeclareLaunchArgument(
        "footprints",
        default_value="",
        description="File of polygons to use instead of traced outlines; empty: outlines are traced.",
    ),
    DeclareLaunchArgument(
        "tile_size", default_value="", description="Side of a tile [m]; empty: as in params_file."
    ),
    DeclareLaunchArgument(
        "max_tiles_in_flight",
        default_value="",
        description="How many tiles may be in the graph at once; empty: as in params_file.",
    ),
    DeclareLaunchArgument(
        "tile_timeout",
        default_value="",
        description="Silence after which a tile in no hands is sent again [s]; empty: as in params_file.",
    ),
    DeclareLaunchArgument(
        "rate",
        default_value="",
        description="Speed as a multiple of the recorded time, 0 = unlimited; empty: as in params_file.",
    ),
    DeclareLaunchArgument(
        "record", default_value="", description="Folder of a bag to record topics in; empty: none."
    ),
    DeclareLaunchArgument(
        "replicas",
        default_value="",
        description="Nodes of which several share the tiles, such as roof_selector:2,model_builder:2.",
    ),
    DeclareLaunchArgument(
        "machines",
        default_value="",
        description="YAML file 'machine: [node, node]': only the nodes of this machine are started here.",
    ),
    DeclareLaunchArgument(
        "machine", default_value=gethostname(), description="Which machine of that file this one is."
    ),
    DeclareLaunchArgument("namespace", default_value="", description="Namespace of all nodes and topics."),
    DeclareLaunchArgument(
        "respawn", default_value="false", description="Whether to restart nodes that died."
    ),
    # launch itself reads both, and gives 5 s each unless told otherwise
    DeclareLaunchArgument(
        "sigterm_timeout",
        default_value="120",
        description="How long nodes may take to finish after SIGINT, until they get SIGTERM [s].",
    ),
    DeclareLaunchArgument(
        "sigkill_timeout",
        default_value="30",
        description="How long nodes may take to end after SIGTERM, until they are killed [s].",
    ),
    DeclareLaunchArgument("rviz", default_value="false", description="Whether to start RViz."),
    DeclareLaunchArgument("log_level", default_value="info", description="debug, info, warn, error, fatal."),
)


def generate_launch_description() -> LaunchDescription:
    """Describe the launch; ``--show-args`` lists its arguments."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=start_nodes)])


def start_nodes(context) -> list:
    """
    Return the nodes: with a writer where there is an output folder, else the builder reports tiles as done.
    """

    def value(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    source, inputs = value("source"), [path for path in value("input").split(":") if path]
    writes = bool(value("output"))
    own = run_settings(source, inputs, value("output"), is_recorded=bool(value("record")))
    own[source] |= {name: kind(value(name)) for name, kind in SOURCE_ARGUMENTS[source].items() if value(name)}
    own["recorder"] = {"output": value("record")}
    own["model_builder"] = {"flow_control.publish_tile_done": not writes}
    own["model_writer"]["overwrite"] = value("overwrite").lower() == "true"
    if value("preset"):
        own["model_writer"]["settings"] = json.dumps({"preset": value("preset")})
    for node, given in _footprints(value("footprints")).items():
        own[node] = own.get(node, {}) | given
    names = [name for name in nodes_until("building_model", source) if writes or name != "model_writer"]
    names += ["recorder"] if value("record") else []
    replicas = replicas_of(value("replicas"))
    if replicas and not value("max_tiles_in_flight"):  # so many that mostly each has one
        own[source]["max_tiles_in_flight"] = min(4 * max(replicas.values()), MOST_TILES)
    shares = {
        replica_name(name, number, replicas.get(name, 1)): (name, (number, replicas.get(name, 1)))
        for name in names
        for number in range(replicas.get(name, 1))
    }
    machines = value("machines")
    here = nodes_of(value("machine"), machines, list(shares)) if machines else set(shares)
    nodes = {
        full: _node(name, own.get(name, {}), value, share)
        for full, (name, share) in shares.items()
        if full in here
    }
    return [*nodes.values(), _rviz(value("namespace"))]


def _footprints(path: str) -> dict[str, dict]:
    """Return the parameters by which nodes know of footprints."""
    if not path:
        return {}
    return {
        "building_tracer": {"footprints.file": path},
        "outline_regulariser": {"keep_outlines": True},
        "model_writer": {"footprints": path},
    }


def _node(name: str, parameters: dict, value, share: tuple) -> Node:
    """Return a node, or one of several that share tiles."""
    full_names = spellings(parameter_names(NODE_CONFIGS[name]))
    number, n_replicas = share
    own = {full_names[key]: list(one) if isinstance(one, tuple) else one for key, one in parameters.items()}
    if n_replicas > 1:
        own = share_parameters(number, n_replicas, _parameter_files(value), name) | own
    return Node(
        package=PACKAGE,
        executable=name,
        name=replica_name(name, number, n_replicas),
        namespace=value("namespace"),
        parameters=[*_parameter_files(value), own],
        remappings=[(one, value(one)) for one in FEED_TOPICS if name == "scan_assembler" and value(one)],
        arguments=["--ros-args", "--log-level", value("log_level")],
        on_exit=partial(_after_exit, name, parameters, value, share),
        output="screen",
    )


def _after_exit(name: str, parameters: dict, value, share: tuple, event, context) -> list:
    """
    Return what follows the end of a node: a new one, the end of all, or nothing.

    Not `respawn=` of launch, which also starts a node again that has finished, or whose parameters are wrong.
    """
    if context.is_shutdown:
        return []
    if event.returncode == WRONG_USE:
        return [EmitEvent(event=Shutdown(reason=f"{name} cannot work with its parameters"))]
    is_dead = event.returncode not in FINISHED
    if is_dead and value("respawn").lower() == "true" and name != "recorder":
        return [TimerAction(period=RESPAWN_DELAY, actions=[_node(name, parameters, value, share)])]
    if name == "model_writer":
        return [EmitEvent(event=Shutdown(reason="the model_writer has ended"))]
    return []


def _parameter_files(value) -> list[str]:
    """Return the parameter files, the one that wins last: the defaults, the preset, a file of the user's."""
    given, preset = value("params_file"), value("preset")
    files = [given, str(preset_file(preset))] if preset else [given]
    return files if Path(given).name == DEFAULTS else files[::-1]


def _rviz(namespace: str) -> Node:
    """Return RViz, started on request."""
    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=namespace,
        arguments=["-d", PathJoinSubstitution([SHARED, "lidar_buildings.rviz"])],
        condition=IfCondition(LaunchConfiguration("rviz")),
        output="screen",
    )
