"""Fixtures that all tests share."""

import os
from pathlib import Path

import pytest

#: Where the real clouds lie unless LIDAR_BUILDINGS_DATA says otherwise: beside the repository.
DEFAULT_DATA = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of real lidar data; skips the test where it is absent."""
    folder = Path(os.environ.get("LIDAR_BUILDINGS_DATA", DEFAULT_DATA)).resolve()
    if not folder.is_dir():
        pytest.skip("real lidar data are absent: set LIDAR_BUILDINGS_DATA to their folder")
    return folder


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files with slow tests first: a worker that gets one last keeps the others waiting."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)
