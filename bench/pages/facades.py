"""Draw the picture of façades: the virtual street canyon as a vehicle sees it."""

import sys
from pathlib import Path

import numpy as np
import shapely

from bench.pages.drawing import plt, save
from bench.street.walls import Ride, facades, ride_of
from lidar_buildings.simulation.live import VehicleConfig

#: Of a round that nothing was developed with.
SEED = 12


def draw_facades(ride: Ride) -> plt.Figure:
    """Draw points (grey), walls that were seen (green), façades found (magenta), unseen in between (cyan)."""
    found, points = facades(ride), ride.points.points
    figure, axes = plt.subplots(figsize=(12.0, 4.4), dpi=80, layout="constrained")
    axes.plot(*points[::9, :2].T, ",", color="0.75")
    for lines, colour, width in (
        (ride.seen, "#9bd08f", 6.0),
        (found.seen, "magenta", 1.4),
        (found.assumed, "cyan", 1.2),
    ):
        for line in lines:
            axes.plot(*shapely.get_coordinates(line).T, color=colour, linewidth=width)
    ends = np.concatenate([shapely.get_coordinates(line) for line in ride.seen])
    (west, south), (east, north) = ends.min(axis=0) - 5.0, ends.max(axis=0) + 5.0
    axes.set(xlim=(west, east), ylim=(south, north))
    axes.set_aspect("equal")
    axes.axis("off")
    return figure


if __name__ == "__main__":
    save(draw_facades(ride_of("street_canyon", SEED, VehicleConfig())), Path(sys.argv[1]), 32)
