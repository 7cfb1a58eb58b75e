"""The package's own declarations: package.xml and setup.py agree with each other and with the code."""

import ast
import re
from xml.etree import ElementTree

from support.source_tree import LAUNCH_FILES, MODULES, ROOT, external_imports, tree_of

import lidar_buildings

#: Import → rosdep key (None: there is none) and distribution on PyPI.
PYTHON_DEPENDENCIES = {
    "laspy": (None, "laspy"),
    "lazrs": (None, "lazrs"),
    "mcap": (None, "mcap"),
    "numba": ("python3-numba", "numba"),
    "numpy": ("python3-numpy", "numpy"),
    "pkg_resources": ("python3-setuptools", "setuptools"),
    "pyogrio": (None, "pyogrio"),
    "pyproj": ("python3-pyproj", "pyproj"),
    "rasterio": ("python3-rasterio", "rasterio"),
    "rosbags": ("python3-rosbags-pip", "rosbags"),
    "scipy": ("python3-scipy", "scipy"),
    "setuptools": ("python3-setuptools", "setuptools"),
    "shapely": ("python3-shapely", "shapely"),
    "sklearn": ("python3-sklearn", "scikit-learn"),
    "threadpoolctl": ("python3-sklearn", "scikit-learn"),  # a requirement of it
    "tqdm": ("python3-tqdm", "tqdm"),
    "yaml": ("python3-yaml", "pyyaml"),
}
#: Import = ROS package → wheel that brings it, None where there is no wheel (a ROS install has it).
ROS_DEPENDENCIES = {
    "ament_index_python": "ros-rclpy",
    "builtin_interfaces": "ros-rclpy",
    "rcl_interfaces": "ros-rclpy",
    "rclpy": "ros-rclpy",
    "diagnostic_msgs": "ros-diagnostic-msgs",
    "geometry_msgs": "ros-geometry-msgs",
    "nav_msgs": "ros-nav-msgs",
    "rosgraph_msgs": "ros-rosgraph-msgs",
    "sensor_msgs": "ros-sensor-msgs",
    "std_msgs": "ros-std-msgs",
    "std_srvs": "ros-std-srvs",
    "visualization_msgs": "ros-visualization-msgs",
    "launch": None,
    "launch_ros": None,
}
#: Imported where they are installed, and not missed where they are not.
OPTIONAL = {
    "dask",
    "distributed",
    "geopandas",
    "open3d",
    "pandas",
    "pypcd4",
    "sensor_msgs_py",
    "shtab",
    "tf2_msgs",
    "tf2_ros",
    "trimesh",
    "upath",
}


def manifest():
    return ElementTree.parse(ROOT / "package.xml").getroot()


def declared(*tags):
    return {element.text for tag in tags for element in manifest().findall(tag)}


def setup_arguments():
    """Keyword → expression of the call of setup(), and the constants above it."""
    tree = tree_of(ROOT / "setup.py")
    constants = {
        node.targets[0].id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    call = next(n for n in ast.walk(tree) if isinstance(n, ast.Call) and ast.unparse(n.func) == "setup")
    return {keyword.arg: keyword.value for keyword in call.keywords}, constants


def distribution(requirement):
    return re.match(r"[A-Za-z0-9_.-]+", requirement).group()


def test_every_import_is_declared_to_ros_and_to_pip():
    used = set().union(*(external_imports(path) for path in MODULES)) - OPTIONAL
    assert used <= set(PYTHON_DEPENDENCIES) | set(ROS_DEPENDENCIES)
    arguments, constants = setup_arguments()
    from_pip = {distribution(text) for text in ast.literal_eval(arguments["install_requires"])}
    wheels = {distribution(text) for text in ast.literal_eval(constants["ROS_WHEELS"])}
    keys = declared("exec_depend", "depend")
    for name in sorted(used & set(PYTHON_DEPENDENCIES)):
        key, project = PYTHON_DEPENDENCIES[name]
        assert project in from_pip, f"{name} is missing in install_requires of setup.py"
        assert key is None or key in keys, f"{name} is missing in package.xml"
    for name in sorted(used & set(ROS_DEPENDENCIES)):
        assert ROS_DEPENDENCIES[name] in wheels, f"{name} is missing in ROS_WHEELS of setup.py"
        assert name in keys, f"{name} is missing in package.xml"


def test_what_launch_files_import_is_declared_to_ros():
    used = set().union(set(), *(external_imports(path) for path in LAUNCH_FILES))
    assert used <= declared("exec_depend", "depend")


def test_every_requirement_of_pip_has_its_rosdep_key_or_is_named_as_having_none():
    key_of = {project: key for key, project in PYTHON_DEPENDENCIES.values()}
    required = {distribution(text) for text in ast.literal_eval(setup_arguments()[0]["install_requires"])}
    keys = declared("exec_depend", "depend")
    assert {project for project in required if key_of[project] not in keys | {None}} == set()
    comment = re.search(
        r"<!-- No rosdep key exists for .*?: (.*?) -->", (ROOT / "package.xml").read_text()
    ).group(1)
    assert set(comment.split()) == {project for project in required if key_of[project] is None}


def test_the_manifest_is_that_of_an_ament_python_package():
    root = manifest()
    assert root.attrib["format"] == "3"
    assert root.findtext("name") == "lidar_buildings"
    assert root.findtext("export/build_type") == "ament_python"
    assert root.findtext("license") == "Apache-2.0"
    assert (ROOT / "resource" / "lidar_buildings").is_file()
    dependencies = [element.text for tag in ("exec_depend", "test_depend") for element in root.findall(tag)]
    assert len(dependencies) == len(set(dependencies))


def test_manifest_and_setup_say_the_same():
    arguments, _ = setup_arguments()
    said = {
        name: ast.literal_eval(arguments[name])
        for name in ("maintainer", "maintainer_email", "description", "license")
    }
    root = manifest()
    assert root.findtext("version") == lidar_buildings.__version__
    assert root.findtext("maintainer") == said["maintainer"]
    assert root.find("maintainer").attrib["email"] == said["maintainer_email"]
    assert root.findtext("description") == said["description"]
    assert root.findtext("license") == said["license"]


def test_the_licence_is_there_in_full():
    text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in text
    assert "Version 2.0, January 2004" in text
    assert "END OF TERMS AND CONDITIONS" in text
