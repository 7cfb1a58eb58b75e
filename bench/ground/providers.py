"""
Agreement with the ground class that the data's providers deliver.

    python -m bench.ground.providers [--data DIR] [--methods METHOD ...] [--pictures DIR]

Delft (AHN3; ground and water), Montpellier and the sparse tiles (IGN LiDAR HD), and fusa; each folder is read
as one cloud. A provider's class is no truth: it is made by a filter, edited by hand to a varying degree, and
not every point on the ground need have it. Three tables therefore: all points, with the share of the points
within 0.15 m of the surface through the provider's ground that have the class (*dense*); the points in 5 m
cells where that share is at least 80 %; and all points but those that lie on that surface without the class.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from bench.common.arguments import add_pictures, parser_of, picture_folder, settings_of
from bench.common.clouds import Cloud, data_folder, read_cloud
from bench.common.tables import percent, table
from bench.ground.methods import METHODS, ground_mask
from bench.ground.scores import SCORE_HEADINGS, cells_of, draw_errors, score_of_mask

#: Folder → classes that count as ground there.
FOLDERS = {"delft": (2, 9), "montpellier": (2,), "fusa": (2,), "lowdensity": (2,)}
#: Points this near the provider's surface should have its class [m].
NEAR_SURFACE = 0.15
#: Side of the cells in which completeness is judged [m], and the least share of a dense one.
DENSITY_CELL = 5.0
MIN_DENSITY = 0.8


def read_folders(data: Path) -> dict[str, Cloud]:
    """Read the folders that are there, by name."""
    found = {name: sorted((data / name).glob("*.laz")) for name in FOLDERS}
    clouds = {name: read_cloud(paths, FOLDERS[name]) for name, paths in found.items() if paths}
    if not clouds:
        raise SystemExit(f"{data}: holds none of {', '.join(FOLDERS)}: give the data folder with --data")
    return clouds


def near_reference(cloud: Cloud) -> NDArray[np.bool_]:
    """Points near the TIN of the reference's ground; beyond its edge, near its nearest point's elevation."""
    ground = cloud.points[cloud.is_ground]
    surface = LinearNDInterpolator(ground[:, :2], ground[:, 2])(cloud.points[:, :2])
    outside = np.isnan(surface)
    surface[outside] = NearestNDInterpolator(ground[:, :2], ground[:, 2])(cloud.points[outside, :2])
    return abs(cloud.points[:, 2] - surface) <= NEAR_SURFACE


def dense_rows(cloud: Cloud, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Points in cells where the reference labels its own ground densely; where there is none, they count."""
    cell = np.floor(cloud.points[:, :2] / DENSITY_CELL).astype(np.int64)
    _, number = np.unique(cell, axis=0, return_inverse=True)
    number = number.ravel()
    n_near = np.bincount(number, weights=near)
    n_labelled = np.bincount(number, weights=near & cloud.is_ground)
    return (n_labelled >= MIN_DENSITY * n_near)[number]


def rows_of(
    clouds: Mapping[str, Cloud],
    methods: Sequence[str],
    settings: Mapping[str, Any] | None = None,
    pictures: Path | None = None,
) -> list[list[list[str]]]:
    """Lines of the three tables: all points, where the reference is dense, without what it left out."""
    tables: list[list[list[str]]] = [[], [], []]
    for name, cloud in clouds.items():
        near = near_reference(cloud)
        parts = (np.ones(len(near), dtype=bool), dense_rows(cloud, near), cloud.is_ground | ~near)
        shares = [cloud.is_ground[near].mean(), *(part.mean() for part in parts[1:])]
        for method in methods:
            mask = ground_mask(cloud, method, settings)
            for rows, part, share in zip(tables, parts, shares, strict=True):
                cells = cells_of(score_of_mask(mask[part], cloud.is_ground[part]))
                rows.append([method, name, percent(share), *cells])
            draw_errors(pictures, method, name, cloud, mask)
    return tables


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = parser_of(__doc__, METHODS)
    add_pictures(parser)
    options = parser.parse_args(arguments)
    clouds = read_folders(data_folder(options.data))
    settings = settings_of(options.set)
    tables = rows_of(clouds, options.methods, settings, picture_folder(options.pictures))
    titles = (
        "All points:",
        f"\nWhere the provider's ground is dense (at least {100 * MIN_DENSITY:.0f} % of what lies on it):",
        "\nWithout the points that lie on the provider's ground and are not of its class:",
    )
    for title, share, rows in zip(titles, ("dense %", "points %", "points %"), tables, strict=True):
        print(title)
        print(table(("method", "cloud", share, *SCORE_HEADINGS), rows))


if __name__ == "__main__":
    main()
