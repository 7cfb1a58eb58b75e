"""Points kept for the page while a cloud is written."""

import numpy as np
import pytest

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.results.classified_files import cloud_sample


def test_points_that_cannot_be_kept_end_in_one_line(tmp_path):
    with (
        pytest.raises(OutputError, match=r"a\.laz\.shown: cannot be written"),
        cloud_sample(tmp_path / "classified" / "a.laz", 1) as keep,
    ):
        keep(0, np.zeros(3))
