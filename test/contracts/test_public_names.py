"""The names that users import from the package itself."""

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
]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_importable_from_the_package(name):
    assert getattr(lidar_buildings, name).__name__ == name
    assert name in lidar_buildings.__all__
    assert name in dir(lidar_buildings)


def test_an_unknown_name_is_no_attribute():
    with pytest.raises(AttributeError, match="no attribute 'clasify_ground'"):
        _ = lidar_buildings.clasify_ground


def test_the_package_alone_imports_neither_numpy_nor_ros():
    assert imported_with("lidar_buildings", "numpy", "numba", "rclpy") == "[]"


def test_what_a_run_reads_before_its_processes_start_is_light():
    """What takes long to import is imported side by side, in the first process and in the command's own."""
    heavy = ["numba", "scipy", "shapely", "laspy", "pyproj", "rclpy"]
    assert imported_with("lidar_buildings.commands.run", *heavy) == "[]"
    assert imported_with("lidar_buildings.pipeline.building_pool", *heavy) == "[]"


def imported_with(module, *names):
    code = f"import sys, {module}; print(sorted({set(names)} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()
