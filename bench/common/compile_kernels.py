"""
Compile the loops that most tests need, so that the test workers find them instead of each compiling its own.

    python -m bench.common.compile_kernels outlines
    python -m bench.common.compile_kernels models

Both may run side by side: they share few loops.
"""

import sys
import tempfile
from pathlib import Path

from bench.scenes import buildings as scenes
from lidar_buildings.cli import main
from lidar_buildings.core.stages.building_model import build_model
from lidar_buildings.core.stages.plane_fitting import fit_roof_planes


def compile_outlines() -> None:
    """Take a thin survey from raw points to outlines."""
    with tempfile.TemporaryDirectory() as folder:
        survey, result = Path(folder) / "survey", Path(folder) / "result"
        main(["simulate", "--output", str(survey), "--density", "1"])
        main(["run", str(survey), "--output", str(result), "--until", "regularisation", "--no-ros"])


def compile_models() -> None:
    """Take a house from its roof points to solids."""
    scene = scenes.l_shape(rotation_deg=20.0)
    points, outline = scene.roof_points(), scene.buildings[0].outline
    planes = fit_roof_planes(points)
    build_model(points, outline, plane_id=planes.plane_id, ground_elevation=scenes.GROUND)


if __name__ == "__main__":
    {"outlines": compile_outlines, "models": compile_models}[sys.argv[1]]()
