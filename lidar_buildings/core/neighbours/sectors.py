"""The eight compass sectors in which what lies around a point is counted."""

from __future__ import annotations

from lidar_buildings.core.kernels import inner_kernel, kernel

#: Sectors of 45° each; the opposite of one is half of them on.
N_SECTORS = 8


@kernel
def sector_of(dx, dy):  # type: ignore[no-untyped-def]
    """Return the sector of a direction in plan, 0 to 7 counterclockwise from east, without trigonometry."""
    if dy < 0.0 or (dy == 0.0 and dx < 0.0):
        return _of_upper_half(-dx, -dy) + 4
    return _of_upper_half(dx, dy)


@inner_kernel
def _of_upper_half(dx, dy):  # type: ignore[no-untyped-def]
    """Return the sector of a direction from east to just before west."""
    if dx > 0.0:
        return 0 if dy < dx else 1
    return 2 if dy > -dx else 3
