"""The names that users import from the package itself."""

import doctest
import importlib
import subprocess
import sys

import pytest

import lidar_buildings

PUBLIC = [
    "classify_ground",
    "select_roofs",
    "label_edges",
    "segment_buildings",
    "trace_boundary",
    "regularise_outline",
    "fit_roof_planes",
    "build_model",
    "GroundFilterConfig",
    "RoofSelectionConfig",
    "EdgeLabellingConfig",
    "SegmentationConfig",
    "BoundaryTracingConfig",
    "RegularisationConfig",
    "PlaneFittingConfig",
    "BuildingModelConfig",
    "read_tile",
    "PointTile",
    "PipelineConfig",
    "reconstruct_tile",
    "read",
    "reconstruct",
    "Reconstruction",
]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_importable_from_the_package(name):
    assert getattr(lidar_buildings, name).__name__ == name
    assert name in lidar_buildings.__all__
    assert name in dir(lidar_buildings)


@pytest.mark.parametrize("of", ["lidar_buildings", "lidar_buildings.commands.from_python"])
def test_the_examples_of_docstrings_hold(of):
    module = importlib.import_module(of)
    failed, tried = doctest.testmod(module)
    assert not failed
    assert tried


def test_an_unknown_name_is_no_attribute():
    with pytest.raises(AttributeError, match="no attribute 'clasify_ground'"):
        _ = lidar_buildings.clasify_ground


def test_the_package_and_what_a_run_reads_before_its_processes_start_are_light():
    """What takes long to import is imported side by side, in the first process and in the command's own."""
    code = """
import sys
import lidar_buildings
assert not {"numpy", "numba", "rclpy"} & set(sys.modules)
import lidar_buildings.commands.run, lidar_buildings.pipeline.building_pool
print(sorted({"numba", "scipy", "shapely", "laspy", "pyproj", "rclpy"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
