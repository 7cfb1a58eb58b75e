"""
Fixtures that all tests share.

"""

import os
from pathlib import Path

import pytest

#: Where the real clouds lie unless LIDAR_BUILDINGS_DATA says otherwise: beside the repository.
DEFAULT_DATA = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """
    Folder of real lidar data; skips the test where it is absent.

    """
    folder = Path(os.environ.get("LIDAR_BUILDINGS_DATA", DEFAULT_DATA)).resolve()
    if not folder.is_dir():
        pytest.skip("real lidar data are absent: set LIDAR_BUILDINGS_DATA to their folder")
    return folder
