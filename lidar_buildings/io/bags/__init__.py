"""rosbag2 (MCAP, sqlite3) and rosbag1 files, read by rosbags without any ROS installation."""

from pathlib import Path

from lidar_buildings.io.files.locations import is_url

_ENDINGS = (".mcap", ".db3", ".bag")
_METADATA = "metadata.yaml"


def is_bag(path: str | Path) -> bool:
    """Whether a path names a bag here: a folder of rosbag2, or a file."""
    if is_url(path):
        return False
    named = Path(path)
    return (named / _METADATA).is_file() if named.is_dir() else is_bag_file(named)


def is_bag_file(path: Path) -> bool:
    """Whether a file is called as those of bags are."""
    return path.name.lower().endswith(_ENDINGS)
