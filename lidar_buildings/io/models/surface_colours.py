"""The colours of surfaces in all formats that have colours."""

from __future__ import annotations

from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE

#: Surface → its material's name and colour (sRGB, 0 to 1).
MATERIALS = {
    ROOF_SURFACE: ("roof", (0.72, 0.29, 0.22)),
    WALL_SURFACE: ("wall", (0.85, 0.82, 0.76)),
    GROUND_SURFACE: ("ground", (0.45, 0.45, 0.42)),
}
TERRAIN = ("terrain", (0.47, 0.53, 0.38))
