"""
Areas on the ground in projections that are not true to scale: a square of 20 m, drawn along geodesics.

    python -m bench.scale.projections

For each system and place: its area by the true one in the system's own units and in the map, in the survey's
middle and 5 km north-east of it, its longer side by the shorter in the map, and what a run says. Last comes
the share of places with an area within 0.2 %.
"""

from __future__ import annotations

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray

from bench.common.tables import table
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.files.reference_systems import about_units, stated_unit, true_frame

#: System → longitudes and latitudes.
PLACES = {
    "EPSG:3857": [(10.0, north) for north in (0.0, 2.0, 5.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0)],
    "EPSG:25832": [(east, 52.0) for east in (6.0, 9.0, 12.0, 15.0, 18.0)],
    "EPSG:3035": [(10.0, 52.0), (-8.0, 40.0), (30.0, 65.0)],
    "EPSG:2154": [(3.0, 46.5), (-4.0, 48.0), (3.0, 42.5)],
    "EPSG:2263": [(-74.0, 40.7)],
    "EPSG:3413": [(-45.0, 70.0), (20.0, 78.0)],
    "EPSG:28992": [(4.4, 52.0), (6.9, 53.3)],
}
SIDE, AWAY, RIGHT = 20.0, 5000.0, 0.002
_GEOD = pyproj.Geod(ellps="WGS84")


def square_at(crs: str, east: float, north: float) -> NDArray[np.float64]:
    """Return the corners of a square on the ground, shape (4, 2), in the system's own units."""
    azimuths = np.array([45.0, 135.0, 225.0, 315.0])
    places = _GEOD.fwd(np.full(4, east), np.full(4, north), azimuths, np.full(4, SIDE / np.sqrt(2.0)))[:2]
    return np.column_stack(pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(*places))


def shape_of(corners: NDArray[np.float64]) -> tuple[float, float]:
    """Return the area by the true one, and the longer side by the shorter."""
    sides = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    return shapely.Polygon(corners).area / SIDE**2, sides.max() / sides.min()


def main() -> None:
    """Print the table."""
    rows, right = [], []
    for crs, places in PLACES.items():
        unit = stated_unit(crs) or 1.0
        for east, north in places:
            middle = square_at(crs, east, north)
            frame = true_frame(MapFrame(crs, (*(unit * middle.mean(axis=0)), 0.0), unit, 1.0))
            far = square_at(crs, *_GEOD.fwd(east, north, 45.0, AWAY)[:2])
            plain = [shape_of(unit * one) for one in (middle, far)]
            ours = [
                shape_of(frame.to_map(np.column_stack([one, np.zeros(4)]))[:, :2]) for one in (middle, far)
            ]
            right += [[abs(one[0] - 1.0) <= RIGHT for one in (*plain, *ours)]]
            corners = [frame.to_map(np.append(one.mean(axis=0), 0.0)[None])[0, :2] for one in (middle, far)]
            codes = [
                one.code for one in about_units(frame, np.array([np.min(corners, 0), np.max(corners, 0)]))
            ]
            cells = [f"{area:.4f}" for area, _ in (plain[0], *ours)]
            rows.append([crs, f"{east:g}, {north:g}", *cells, f"{ours[0][1]:.4f}", ", ".join(codes)])
    print(table(["system", "place", "plain", "in the map", "5 km away", "sides", "told"], rows))
    plain, far_plain, ours, far = np.mean(right, axis=0)
    print(f"right: {plain:.2f} plain, {ours:.2f} in the map; 5 km away {far_plain:.2f}, {far:.2f}")


if __name__ == "__main__":
    main()
