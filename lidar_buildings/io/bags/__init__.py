"""rosbag2 (MCAP, sqlite3) and rosbag1 files, read by rosbags without any ROS installation."""

import re
from collections.abc import Sequence
from pathlib import Path

from lidar_buildings.io.clouds.find_inputs import is_cloud_file
from lidar_buildings.io.files.locations import is_url

_STORAGES = (".mcap", ".db3")
_ENDINGS = (*_STORAGES, ".bag")
#: What rosbag2 writes into a bag's folder when it is done.
METADATA = "metadata.yaml"
#: How rosbag2 calls the files of a bag: by its name, and their numbers.
_SPLIT = re.compile(r"(.*)_(\d+)")


def is_bag(path: str | Path) -> bool:
    """Whether a path names a bag here: a folder of rosbag2, whose metadata may be missing, or a file."""
    if is_url(path):
        return False
    named = Path(path)
    return (named / METADATA).is_file() or bool(split_files(named)) if named.is_dir() else is_bag_file(named)


def is_bag_file(path: Path) -> bool:
    """Whether a file is called as those of bags are."""
    return path.name.lower().endswith(_ENDINGS)


def bags_of(path: str | Path) -> list[Path]:
    """Return the bags that a path names: itself, or those directly in a folder without clouds, by name."""
    if is_bag(path):
        return [Path(path)]
    has_clouds, bags = _held(path)
    return [] if has_clouds else bags


def bags_among(inputs: Sequence[str]) -> list[Path]:
    """Return the bags among inputs, and in folders among them, each once."""
    return list(dict.fromkeys(bag.resolve() for one in inputs for bag in bags_of(one)))


def bags_beside_clouds(path: str | Path) -> list[Path]:
    """Return the bags directly in a folder of which the clouds alone are taken, by name."""
    has_clouds, bags = _held(path)
    return bags if has_clouds and not is_bag(path) else []


def _held(path: str | Path) -> tuple[bool, list[Path]]:
    """Return whether clouds lie directly in a folder, and the bags that do; nothing lies in anything else."""
    if is_url(path) or not Path(path).is_dir():
        return False, []
    files = list(Path(path).iterdir())
    return any(map(is_cloud_file, files)), sorted(filter(is_bag, files))


def split_files(folder: Path) -> list[Path]:
    """Return the storage files in a folder in their order, if they are one bag's by name and number."""
    files = [one for one in folder.iterdir() if is_bag_file(one) or is_cloud_file(one)]
    parts = [_SPLIT.fullmatch(one.stem) for one in files]
    kinds = {(part and part[1], one.suffix.lower()) for part, one in zip(parts, files, strict=True)}
    if len(kinds) != 1 or None in parts or kinds.pop()[1] not in _STORAGES:
        return []
    numbered = dict(sorted((int(part[2]), one) for part, one in zip(parts, files, strict=True) if part))
    return list(numbered.values()) if max(numbered) - min(numbered) == len(files) - 1 else []
