"""Files that come with the package: parameters with their defaults, and the presets. It needs no ROS."""

from __future__ import annotations

import sys
from pathlib import Path

from lidar_buildings.core.model.errors import InputError, ParameterError

#: The papers whose whole chain one word chooses, each with a page in `doc/papers` and a parameter file.
PRESETS = ("santos", "villalba", "sampath_shan")


def preset_file(name: str) -> Path:
    """
    Return the parameter file of a preset.

    Raises
    ------
    ParameterError
        If there is no such preset.
    InputError
        If its file was not installed.
    """
    if name not in PRESETS:
        raise ParameterError(f"--preset {name}: must be one of {', '.join(PRESETS)}")
    found = shared_file(f"{name}.param.yaml")
    if found is None:
        raise InputError(f"{name}.param.yaml: not installed beside pipeline.param.yaml: give it as --params")
    return found


def shared_file(name: str) -> Path | None:
    """Return a file of `config`: as a ROS workspace or pip installed it, or beside the source."""
    package = Path(__file__).resolve().parents[1]
    candidates = [package.parent / "config" / name]
    try:
        from ament_index_python.packages import get_package_share_directory

        candidates.append(Path(get_package_share_directory(package.name), "config", name))
    except (ImportError, LookupError, OSError):  # no ament, no such package, no AMENT_PREFIX_PATH
        pass
    candidates.append(Path(sys.prefix, "share", package.name, "config", name))
    return next((path for path in candidates if path.is_file()), None)
