"""Whether the libraries that the package needs are installed, in versions that do."""

from __future__ import annotations

import re
from importlib import metadata

from lidar_buildings.core.model.errors import LidarBuildingsError

#: A requirement of a run; those of extras have a marker after them.
_NEEDED = re.compile(r"([\w-]+)>=([\w.]+)$")


def check_versions() -> None:
    """Raise an error that names the libraries that are missing or too old."""
    try:
        requirements = metadata.requires("lidar_buildings") or []
    except metadata.PackageNotFoundError:  # a clone that is not installed
        return
    wrong = []
    for needed in filter(None, map(_NEEDED.match, requirements)):
        installed = _installed(needed[1])
        if _release(installed) < _release(needed[2]):
            wrong.append(f"{needed[0]} is needed, {installed or 'none'} is installed")
    if wrong:
        raise LidarBuildingsError("; ".join(wrong))


def _installed(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def _release(version: str) -> tuple[int, ...]:
    """Return the numbers of a version, without what follows them (`.post1`, `rc1`)."""
    return tuple(int(number) for number in re.findall(r"(?:^|\.)(\d+)(?=\.|$)", version))
