"""The contracts of the source tree: who may import whom, and what code may not contain."""

import ast

import pytest
from support.source_tree import (
    LAUNCH_FILES,
    MODULES,
    ROOT,
    dotted,
    external_imports,
    imports_of,
    package_of,
    tree_of,
)

#: Packages of ROS and what comes with it.
ROS_PREFIXES = ("rclpy", "rcl_", "ament_", "launch", "tf2", "sensor_msgs_py")


#: Layer → layers it may import.
LAYERS = {
    "core": {"core"},
    "pipeline": {"core", "pipeline"},
    "io": {"core", "io"},
    "evaluation": {"core", "io", "evaluation"},
    "simulation": {"core", "io", "simulation"},
    "ros": {"core", "ros"},
    "report": {"core", "pipeline", "io", "report"},
    "nodes": {"core", "pipeline", "io", "report", "ros", "nodes"},
    "commands": {"core", "pipeline", "io", "report", "ros", "nodes", "simulation", "commands"},
}
#: Layer → its rooms from the ground up: one may import those before it, and the stages not each other.
ROOMS = {
    "core": ("model", "scans", "neighbours", "surfaces", "solids", "stages"),
    "io": ("files", "clouds", "tiling", "bags", "vectors", "models", "results"),
    "evaluation": ("scores", "readers", "command"),
}
#: Rooms of io that do not know of each other.
APART = {("vectors", "clouds"), ("vectors", "tiling"), ("models", "clouds"), ("models", "tiling")}
APART |= {("models", "vectors"), ("results", "tiling")}
#: A stage that is a step of another one, which alone may import it.
STEPS = {"roof_topology": "building_model"}
#: The command line: it may import all layers, and nothing imports it.
TOP = {"cli", "__main__"}
#: What may run without ROS, though it stands beside what needs it.
WITHOUT_ROS = {
    "lidar_buildings.commands.run_local",
    "lidar_buildings.commands.settings",
    "lidar_buildings.nodes.configs",
    "lidar_buildings.nodes.table",
    "lidar_buildings.ros.depths",
}
WITH_ROS = {"lidar_buildings.commands.run", "lidar_buildings.commands.running_graph"}
#: Third-party packages that the core is made of.
CORE_LIBRARIES = {"numpy", "scipy", "numba", "sklearn", "threadpoolctl", "shapely", "open3d"}


def layer_of(module):
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else ""


def room_of(module):
    """The room of its layer that a module stands in, None outside."""
    parts = module.split(".")
    return parts[2] if len(parts) > 2 and parts[2] in ROOMS.get(parts[1], ()) else None


def stage_of(module):
    parts = module.split(".")
    return parts[3] if room_of(module) == "stages" and len(parts) > 3 else None


def internal_refusal(module, imported):
    """Say why one module must not import another of the package, None if it may."""
    mine, theirs = layer_of(module), layer_of(imported)
    if theirs and mine not in TOP and theirs not in LAYERS.get(mine, {mine}):
        return f"{module} imports {imported}: {mine or 'the package itself'} must not import {theirs}"
    needs_ros = imported in WITH_ROS or (theirs in ("ros", "nodes") and imported not in WITHOUT_ROS)
    if module in WITHOUT_ROS and needs_ros:
        return f"{module} imports {imported}: it must run without ROS"
    here, there = room_of(module), room_of(imported)
    if here and there and mine == theirs:
        if ROOMS[mine].index(there) > ROOMS[mine].index(here):
            return f"{module} imports {imported}: {here} stands below {there}"
        if (here, there) in APART:
            return f"{module} imports {imported}: {here} does not know of {there}"
    other = stage_of(imported)
    if here == "stages" and other and other != stage_of(module) != STEPS.get(other):
        return f"{module} imports {imported}: stages do not import each other"
    return None


def test_imports_go_one_way():
    refused = [
        reason
        for path in MODULES
        for imported in imports_of(tree_of(path), package_of(path))
        if imported.startswith("lidar_buildings")
        and (reason := internal_refusal(dotted(path), imported)) is not None
    ]
    assert refused == []


@pytest.mark.parametrize(
    ("module", "imported"),
    [
        ("lidar_buildings.core.model.tile", "lidar_buildings.io.clouds.las"),
        ("lidar_buildings.core.stages.segmentation.windows", "lidar_buildings.core.stages.boundary_tracing"),
        ("lidar_buildings.core.neighbours.point_spacing", "lidar_buildings.core.stages.ground_filter.config"),
        ("lidar_buildings.core.stages.roof_selection", "lidar_buildings.pipeline.tile_stages"),
        ("lidar_buildings.commands.run_local", "lidar_buildings.ros.qos"),
        ("lidar_buildings.commands.run_local", "lidar_buildings.commands.run"),
        ("lidar_buildings.commands.settings", "lidar_buildings.nodes.graph"),
        ("lidar_buildings.io.models.obj", "lidar_buildings.io.vectors.layers"),
        ("lidar_buildings.evaluation.scores.edges", "lidar_buildings.evaluation.command.score"),
        ("lidar_buildings.io.results.output_folder", "lidar_buildings.report.page_file"),
        ("lidar_buildings.unheard_of", "lidar_buildings.core.model.tile"),
    ],
)
def test_an_import_against_the_directions_would_be_refused(module, imported):
    assert internal_refusal(module, imported) is not None


def test_imports_are_found_however_they_are_written():
    plain = "import a.b as c\nfrom lidar_buildings.core.model import tile\n"
    code = plain + "def f():\n    from ..io.clouds import las\n    from . import x"
    found = set(imports_of(ast.parse(code), "lidar_buildings.core"))
    assert found == {
        "a.b",
        "lidar_buildings.core.model.tile",
        "lidar_buildings.io.clouds.las",
        "lidar_buildings.core",
    }


def is_of_ros(name):
    return name.startswith(ROS_PREFIXES) or name.endswith(("_msgs", "_srvs", "_interfaces"))


def test_the_core_knows_neither_ros_nor_file_formats():
    foreign = {
        dotted(p): external_imports(p) - CORE_LIBRARIES for p in MODULES if layer_of(dotted(p)) == "core"
    }
    assert {module: names for module, names in foreign.items() if names} == {}


def test_only_nodes_and_what_they_share_import_ros_and_configs_do_not():
    with_ros = {layer_of(dotted(p)) for p in MODULES if any(is_of_ros(name) for name in external_imports(p))}
    assert with_ros <= {"ros", "nodes", "commands"}
    found = {dotted(p): external_imports(p) for p in MODULES if dotted(p) in WITHOUT_ROS}
    assert found.keys() == WITHOUT_ROS
    of_nodes = [name for module, names in found.items() if layer_of(module) == "nodes" for name in names]
    assert not any(map(is_of_ros, of_nodes))


def calls(tree, name):
    """Line numbers of calls of a plain name or of a dotted one."""
    return [n.lineno for n in ast.walk(tree) if isinstance(n, ast.Call) and ast.unparse(n.func) == name]


@pytest.mark.parametrize(
    ("name", "layers"),
    [
        ("print", ("core", "io", "report", "ros", "nodes", "pipeline")),
        ("open", ("core", "ros", "pipeline")),
        ("sys.exit", ("core", "io", "ros", "pipeline", "simulation", "commands", "evaluation")),
        ("exit", ("core", "io", "ros", "nodes", "pipeline", "simulation", "commands", "evaluation")),
    ],
)
def test_what_belongs_to_the_command_line_or_to_files_stays_there(name, layers):
    found = [
        f"{dotted(path)}:{line}"
        for path in MODULES
        if layer_of(dotted(path)) in layers
        for line in calls(tree_of(path), name)
    ]
    assert found == []


def test_input_is_checked_by_exceptions_not_by_assert():
    found = [
        f"{dotted(path)}:{node.lineno}"
        for path in MODULES
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Assert)
    ]
    assert found == []


def test_no_module_is_a_drawer_for_everything():
    drawers = {"utils", "util", "helpers", "helper", "common", "misc"}
    everywhere = [*MODULES, *(ROOT / "test").rglob("*.py"), *LAUNCH_FILES]
    assert [path.name for path in everywhere if path.stem in drawers] == []


def test_no_module_is_longer_than_650_lines():
    assert [dotted(p) for p in MODULES if len(p.read_text(encoding="utf-8").splitlines()) > 650] == []
