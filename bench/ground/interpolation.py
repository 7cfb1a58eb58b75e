"""
How near the DTM comes to ground that was hidden from it, by each method of interpolation.

    python -m bench.ground.interpolation [--data DIR] [--methods METHOD ...]

The ground is the provider's. Hidden are, by turns, every tenth point; and discs of 4 and of 8 m radius, as
buildings hide it, over a tenth of the points. The DTM of the rest, bilinear between cells, is
compared with the hidden points; beside it stand the processor seconds of both rasters. Of kriging the last
column tells how many of the hidden points lie within twice its standard deviation: 95 % if it is right.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from bench.common.arguments import parser_of
from bench.common.clouds import Cloud, data_folder, read_cloud
from bench.common.tables import percent, table
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.interpolation import METHODS
from lidar_buildings.core.stages.terrain.rasters import make_rasters

#: Name → files.
CLOUDS = {
    "delft": "delft/*.laz",
    "montpellier": "montpellier/*.laz",
    "fusa": "fusa/*.laz",
    "sparse town": "lowdensity/*.laz",
    "st barth": "stbarth/*.laz",
    "alpine forest": "terrain/alps_forest.laz",
    "florida": "terrain/florida.laz",
    "river bank": "terrain/river_bridge.laz",
}
#: What is hidden: radius of discs [m], 0 for single points.
RADII = (0.0, 4.0, 8.0)
SHARE = 0.1
HEADINGS = ["cloud", "hidden", "method", "mean [mm]", "RMSE [mm]", "95 % [mm]", "CPU [s]", "in 2 σ [%]"]


def hidden_rows(ground: NDArray[np.float64], radius: float) -> NDArray[np.intp]:
    """Return about a tenth of the ground's points: scattered, or those in discs round some of them."""
    order = np.random.default_rng(0).permutation(len(ground))
    if radius == 0.0:
        return np.sort(order[: int(SHARE * len(ground))])
    tree, hidden = cKDTree(ground[:, :2]), np.zeros(len(ground), dtype=bool)
    for row in order:
        if hidden.mean() >= SHARE:
            break
        hidden[tree.query_ball_point(ground[row, :2], radius)] = True
    return np.flatnonzero(hidden)


def errors(
    cloud: Cloud, hidden: NDArray[np.intp], method: str
) -> tuple[NDArray[np.float64], float, NDArray[np.float64] | None]:
    """Return DTM less each hidden point [m], processor seconds, and its parts of the standard deviation."""
    classes = np.where(cloud.is_ground, 2, 1).astype(np.uint8)
    classes[hidden] = 1
    started = time.process_time()
    found = make_rasters(cloud.points, classes, RasterConfig(dtm_interpolation=method))
    seconds = time.process_time() - started
    west, north = found.window.corner
    x, y, z = cloud.points[hidden].T
    places = [(north - y) / found.window.resolution - 0.5, (x - west) / found.window.resolution - 0.5]
    off = map_coordinates(found.dtm, places, order=1, mode="nearest") - z
    known = ~np.isnan(off)
    if found.dtm_variance is None:
        return off[known], seconds, None
    variance = map_coordinates(found.dtm_variance, places, order=1, mode="nearest")
    return off[known], seconds, np.abs(off[known]) / np.sqrt(variance[known])


def rows_of(cloud: Cloud, name: str, methods: list[str]) -> Iterator[list[str]]:
    """Yield a table's rows: one for each kind of hiding and method."""
    of_ground = np.flatnonzero(cloud.is_ground)
    for radius in RADII:
        hidden = of_ground[hidden_rows(cloud.points[of_ground], radius)]
        for method in methods:
            off, seconds, parts = errors(cloud, hidden, method)
            rmse, most = np.sqrt(np.mean(off**2)), np.percentile(np.abs(off), 95)
            figures = [f"{1000 * one:.0f}" for one in (off.mean(), rmse, most)]
            what = f"discs of {radius:g} m" if radius else "points"
            within = "" if parts is None else percent(float((parts <= 2.0).mean()))
            yield [name, what, method, *figures, f"{seconds:.2f}", within]


def main() -> None:
    """Print a table for each cloud."""
    options = parser_of(__doc__, METHODS).parse_args()
    data = data_folder(options.data)
    for name, pattern in CLOUDS.items():
        paths: list[Path] = sorted(data.glob(pattern))
        if paths:
            cloud = read_cloud(paths, (2, 9))
            errors(cloud, np.zeros(0, dtype=np.intp), options.methods[0])  # compiles
            print(table(HEADINGS, rows_of(cloud, name, options.methods)), flush=True)


if __name__ == "__main__":
    main()
