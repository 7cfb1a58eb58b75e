"""
Write the drawing without entities that stands around those of every DXF file, made by ezdxf.

    python -m bench.common.empty_drawing
"""

import ezdxf

from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from lidar_buildings.io.models.dxf import APPLICATION, COURTYARD, EMPTY, LINES, OUTLINE, TERRAIN, layer_name

#: AutoCAD 2000: the oldest version with light polylines and units, which everything reads.
VERSION = "R2000"
#: Surface → number of its colour: red, light grey, dark grey.
COLOURS = {ROOF_SURFACE: 1, WALL_SURFACE: 9, GROUND_SURFACE: 8}


def main() -> None:
    """Write the drawing, with fixed dates and identifiers."""
    ezdxf.options.write_fixed_meta_data_for_testing = True
    drawing = ezdxf.new(VERSION, units=6)
    drawing.header["$MEASUREMENT"] = 1
    drawing.appids.add(APPLICATION)
    layers = {layer_name(level, kind): COLOURS[kind] for level in ("1.2", "1.3", "2.2") for kind in COLOURS}
    layers |= {OUTLINE: 7, COURTYARD: 7, TERRAIN: 94} | {name: 2 + k for k, name in enumerate(LINES.values())}
    for name, colour in layers.items():
        drawing.layers.add(name, color=colour)
    drawing.saveas(EMPTY)


if __name__ == "__main__":
    main()
