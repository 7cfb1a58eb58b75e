"""Surveys to be cut into tiles, and which of their points a tile holds."""

import numpy as np
from support import cloud_files

WEST, SOUTH = 84900.0, 447000.0


def survey(tmp_path, xy_of_files, *, ending=".las", **options):
    """Write one file per array of plan coordinates."""
    paths = []
    for number, xy in enumerate(xy_of_files):
        cloud = cloud_files.random_cloud(len(xy), seed=number, **options)
        cloud.x, cloud.y = xy[:, 0], xy[:, 1]
        paths.append(cloud_files.saved(cloud, tmp_path / f"part_{number}{ending}"))
    return paths


def square(n_points, west, south, size, seed=0):
    return (
        np.random.default_rng(seed)
        .uniform([west, south], [west + size, south + size], (n_points, 2))
        .round(3)
    )


def two_neighbours(tmp_path, n_points=400):
    return survey(
        tmp_path, [square(n_points, WEST, SOUTH, 100.0, 1), square(n_points, WEST + 100.0, SOUTH, 100.0, 2)]
    )


def tiles_of(source):
    """The tiles of a source, each put together when its turn comes."""
    return (tile.read() for tile in source.ready())


def names(tile, rows=slice(None)):
    return list(zip(tile.source[rows].tolist(), tile.index[rows].tolist(), strict=True))


def core_names(tiles):
    return [name for tile in tiles for name in names(tile, tile.is_core)]


def all_names(source):
    return [(number, index) for number, file in enumerate(source.inputs) for index in range(file.point_count)]


def grown_fully(source, tile):
    steps = []
    while (tile := source.grown(tile.stamp)) is not None:
        steps.append(tile)
    return steps
