"""Draw the picture of outlines closed behind walls: the virtual village as a vehicle sees it."""

import sys
from pathlib import Path

from bench.outlines.streets import draw_street, drive_through
from bench.pages.drawing import save
from lidar_buildings.pipeline.config import PipelineConfig

#: Of a round that nothing was developed with.
SEED = 12

if __name__ == "__main__":
    save(draw_street(drive_through("village", SEED, PipelineConfig()), size=10.0), Path(sys.argv[1]), 32)
