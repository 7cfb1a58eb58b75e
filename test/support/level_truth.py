"""Where points of a level frame lie in a grid, by PROJ's own steps."""

import numpy as np
import pyproj


def in_grid(points, origin, crs):
    """The grid's coordinates of points: topocentric, geocentric, geographic, grid."""
    place = f"+lon_0={origin.longitude} +lat_0={origin.latitude} +h_0={origin.height}"
    to_earth = pyproj.Transformer.from_pipeline(
        f"+proj=pipeline +ellps=WGS84 +step +inv +proj=topocentric {place} +step +inv +proj=cart "
        "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    to_grid = pyproj.Transformer.from_crs("EPSG:4979", crs, always_xy=True)
    return np.column_stack(to_grid.transform(*to_earth.transform(*points.T)))
