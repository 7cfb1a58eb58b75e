"""
The contracts of the source tree: who may import whom, and what code may not contain.

"""

import ast

import pytest
from source_tree import LAUNCH_FILES, MODULES, ROOT, dotted, external_imports, imports_of, package_of, tree_of

#: Packages of ROS and what comes with it.
ROS_PREFIXES = ("rclpy", "rcl_", "ament_", "launch", "tf2", "sensor_msgs_py")


#: Layer → layers it may import. A module at the package's root is a layer of its own name.
LAYERS = {
    "core": {"core"},
    "io": {"core", "io"},
    "ros": {"core", "ros"},
    "nodes": {"core", "io", "ros", "nodes"},
    "simulation": {"core", "io", "simulation"},
    "pipeline": {"core"},
    "settings": {"core"},
    "run_local": {"core", "io", "pipeline", "settings"},
    "score_table": set(),
    "score_sides": {"core", "io"},
    "score_edges": {"core", "io", "score_sides"},
    "score_models": {"core", "io", "score_sides"},
    "score_planes": {"core", "io", "score_sides"},
    "score_outlines": {"core", "io", "score_sides"},
    "score_kinds": {
        "core",
        "io",
        "score_edges",
        "score_models",
        "score_outlines",
        "score_planes",
        "score_sides",
    },
    "score": {"core", "io", "score_kinds", "score_sides", "score_table"},
}
#: Layers of the modules that carry out ``lidar-buildings run``: run.py, run_*.py (without ROS: run_local.py).
RUN_LAYERS = {"core", "io", "ros", "nodes", "pipeline", "settings"}
#: The command line: it may import all layers, and nothing imports it.
TOP = {"cli", "__main__"}
#: The stages; a stage is a module, modules that begin with its name and "_", or a folder.
STAGES = (
    "ground_filter",
    "roof_selection",
    "edge_labelling",
    "segmentation",
    "boundary_tracing",
    "regularisation",
    "plane_fitting",
    "building_model",
)
#: Where the stages are put together for a tile: they may import stages, and the core does not import them.
TILE_MODULES = {
    "lidar_buildings.pipeline.tile_models",
    "lidar_buildings.pipeline.tile_outlines",
    "lidar_buildings.pipeline.tile_stages",
}
#: Third-party packages that the core is made of.
CORE_LIBRARIES = {"numpy", "scipy", "numba", "sklearn", "shapely", "mapbox_earcut"}


def layer_of(module):
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else ""


def stage_of(module):
    """
    The stage that a module of the core belongs to, None for the small shared modules.

    """
    if not module.startswith("lidar_buildings.core."):
        return None
    name = module.split(".")[2]
    return next((stage for stage in STAGES if name == stage or name.startswith(f"{stage}_")), None)


def is_run(layer):
    return layer == "run" or layer.startswith("run_")


def allowed_layers(layer, imported):
    """
    The layers that a layer may import; of the run's modules one may import another.

    """
    if is_run(layer):
        return LAYERS.get(layer, RUN_LAYERS) | (
            {imported} if is_run(imported) and layer not in LAYERS else set()
        )
    return LAYERS.get(layer, {layer})


def internal_refusal(module, imported):
    """
    Say why one module must not import another of the package, None if it may.

    """
    mine, theirs = layer_of(module), layer_of(imported)
    if theirs and mine not in TOP and theirs not in allowed_layers(mine, theirs):
        return f"{module} imports {imported}: {mine or 'the package itself'} must not import {theirs}"
    if mine == "core" and module not in TILE_MODULES:
        stage = stage_of(imported)
        if imported in TILE_MODULES or (stage and stage != stage_of(module)):
            return f"{module} imports {imported}: stages do not import each other, nor shared modules stages"
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
        ("lidar_buildings.core.model.tile", "lidar_buildings.pipeline.reconstruct"),
        ("lidar_buildings.io.clouds.las", "lidar_buildings.ros.qos"),
        ("lidar_buildings.ros.qos", "lidar_buildings.nodes.tile_player"),
        ("lidar_buildings.nodes.tile_player", "lidar_buildings.cli"),
        ("lidar_buildings.pipeline.reconstruct", "lidar_buildings.io.clouds.las"),
        ("lidar_buildings.core.stages.segmentation.windows", "lidar_buildings.core.stages.boundary_tracing"),
        ("lidar_buildings.core.neighbours.point_spacing", "lidar_buildings.core.stages.ground_filter.config"),
        ("lidar_buildings.core.stages.roof_selection", "lidar_buildings.pipeline.tile_stages"),
        ("lidar_buildings.commands.run_local", "lidar_buildings.ros.qos"),
        ("lidar_buildings.commands.run_local", "lidar_buildings.commands.run"),
        ("lidar_buildings.commands.run", "lidar_buildings.cli"),
        ("lidar_buildings.io.clouds.las", "lidar_buildings.commands.run_local"),
        ("lidar_buildings.unheard_of", "lidar_buildings.core.model.tile"),
    ],
)
def test_an_import_against_the_directions_would_be_refused(module, imported):
    assert internal_refusal(module, imported) is not None


@pytest.mark.parametrize(
    ("module", "imported"),
    [
        ("lidar_buildings.core.stages.segmentation", "lidar_buildings.core.stages.segmentation.windows"),
        ("lidar_buildings.pipeline.tile_stages", "lidar_buildings.core.stages.ground_filter"),
        ("lidar_buildings.nodes.tile_player", "lidar_buildings.io.clouds.las"),
        ("lidar_buildings.commands.run", "lidar_buildings.commands.run_local"),
        ("lidar_buildings.cli", "lidar_buildings.evaluation.command.score"),
    ],
)
def test_an_import_along_the_directions_is_allowed(module, imported):
    assert internal_refusal(module, imported) is None


def test_imports_are_found_however_they_are_written():
    plain = "import a.b as c\nfrom lidar_buildings.core import tile\n"
    code = plain + "def f():\n    from ..io import las\n    from . import x"
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


def test_only_nodes_and_what_they_share_import_ros():
    with_ros = {layer_of(dotted(p)) for p in MODULES if any(is_of_ros(name) for name in external_imports(p))}
    assert {layer for layer in with_ros - {"ros", "nodes"} if not is_run(layer) or layer in LAYERS} == set()


@pytest.mark.parametrize("name", ["rclpy", "sensor_msgs", "std_srvs", "builtin_interfaces", "tf2_ros"])
def test_packages_of_ros_are_recognised(name):
    assert is_of_ros(name)
    assert not is_of_ros("numpy")


def calls(tree, name):
    """
    Line numbers of calls of a plain name or of a dotted one.

    """
    return [n.lineno for n in ast.walk(tree) if isinstance(n, ast.Call) and ast.unparse(n.func) == name]


@pytest.mark.parametrize(
    ("name", "layers"),
    [
        ("print", ("core", "io", "ros", "nodes", "pipeline", "settings")),
        ("open", ("core", "ros", "pipeline")),
        ("sys.exit", ("core", "io", "ros", "pipeline", "simulation", "settings", "score")),
        ("exit", ("core", "io", "ros", "nodes", "pipeline", "simulation", "settings", "score")),
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


def test_calls_are_found():
    assert calls(ast.parse("def f():\n    print('x')\nsys.exit(2)"), "print") == [2]
    assert calls(ast.parse("def f():\n    print('x')\nsys.exit(2)"), "sys.exit") == [3]


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


def test_no_module_is_longer_than_400_lines():
    assert [dotted(p) for p in MODULES if len(p.read_text(encoding="utf-8").splitlines()) > 400] == []
