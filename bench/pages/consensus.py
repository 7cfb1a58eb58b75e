"""
Draw the picture of the page on the majority of three: scenes of the tests it masters, and two it does not.
"""

import sys
from pathlib import Path

from bench.pages.drawing import save
from bench.pages.morphological import draw_scenes
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig

#: Scene → what to see, and along which axis and where its profile is cut, as a share of its extent.
SCENES = {
    "bridge_over_cut": ("bridge: its deck is climbed in part", 0, 0.5),
    "quarry": ("quarry: cliffs and diggers", 0, 0.5),
    "hall_in_hillside": ("hall in a hillside: climbed from the back", 0, 0.5),
    "steep_forest": ("undergrowth on 30 to 40°", 1, 0.5),
}


def main(picture: Path) -> None:
    """Draw every scene in plan and in profile."""
    save(draw_scenes(SCENES, GroundFilterConfig()), picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
