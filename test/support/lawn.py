"""Two flat houses on level ground, and the file that holds them."""

import laspy
import numpy as np

#: Where the tiny clouds lie in their reference system.
CORNER = np.array([85_000.0, 447_000.0])
#: West, south, east and north of two houses, the elevations of their roofs, and the density of the pulses.
HOUSES, ELEVATION, DENSITY = ((6, 6, 18, 16), (22, 6, 32, 16)), (7.0, 9.0), 8.0


def houses_on_a_lawn(seed=0, houses=HOUSES, elevations=ELEVATION, width=40.0):
    """Points of level ground and flat roofs, and which are on a roof."""
    generator = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(0.0, width, DENSITY**-0.5), np.arange(0.0, 24.0, DENSITY**-0.5))
    xy = np.column_stack((x.ravel(), y.ravel())) + generator.uniform(0, 0.1, (x.size, 2))
    z = generator.normal(0.0, 0.02, len(xy))
    roof = np.zeros(len(xy), dtype=bool)
    for (west, south, east, north), elevation in zip(houses, elevations, strict=True):
        inside = (xy > (west, south)).all(axis=1) & (xy < (east, north)).all(axis=1)
        z[inside] += elevation
        roof |= inside
    return np.column_stack((xy, z)), roof


def write_las(path, points, classes, corner=CORNER, **columns):
    path.parent.mkdir(parents=True, exist_ok=True)
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 0.001)
    las = laspy.LasData(header)
    las.xyz = points + np.append(corner, 0.0)
    las.classification = classes.astype(np.uint8)
    las.return_number[:] = las.number_of_returns[:] = 1
    for name, values in columns.items():
        las[name] = values
    las.write(path)
