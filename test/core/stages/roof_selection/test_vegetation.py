import numpy as np
import pytest

from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs, vegetation_classes


@pytest.mark.parametrize(
    ("height", "expected"),
    [
        (-5.0, 1),
        (0.0, 1),
        (0.0099, 1),
        (0.01, 3),
        (0.1999, 3),
        (0.2, 4),
        (2.9999, 4),
        (3.0, 5),
        (149.99, 5),
        (150.0, 1),
        (1000.0, 1),
    ],
)
def test_vegetation_is_low_medium_or_high_by_the_heights_of_the_paper(height, expected):
    """Mancera-Taboada and others (2012): 0.01 to 0.2 m, 0.2 to 3 m, 3 to 150 m."""
    assert vegetation_classes(np.array([height]), RoofSelectionConfig()).tolist() == [expected]
    # The same through the stage: lone points are no roof.
    point = np.array([[0.0, 0.0, height]])
    classes = select_roofs(point, height_above_ground=[height], classification=[1]).classification
    assert classes.tolist() == [expected]


def test_the_limits_are_parameters():
    config = RoofSelectionConfig(
        low_vegetation_height=0.5, medium_vegetation_height=2.0, max_vegetation_height=50.0
    )
    found = vegetation_classes(np.array([0.3, 0.5, 1.9, 2.0, 49.0, 50.0]), config)
    assert found.tolist() == [3, 4, 4, 5, 5, 1]
