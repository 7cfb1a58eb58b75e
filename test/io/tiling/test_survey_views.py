"""From where the points of files were seen, the same in all tiles."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from support.cut_surveys import tiles_of
from support.street_points import cloud_of, seen_from_above, seen_from_street

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.clouds.las import read_tile
from lidar_buildings.io.tiling.placed_laz import PlacedLaz
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig


def tiles(paths: list[Path], **parameters: str) -> list[PointTile]:
    """Return the tiles of files, small ones."""
    config = TilingConfig(tile_size=30.0, buffer=10.0, max_buffer=10.0, **parameters)
    with TileSource(paths, config) as source:
        return list(tiles_of(source))


@pytest.fixture
def air(tmp_path: Path) -> Path:
    """A strip from above."""
    cloud_of(seen_from_above()).write(tmp_path / "air.laz")
    return tmp_path / "air.laz"


@pytest.fixture
def street(tmp_path: Path) -> Path:
    """A drive through the same place, of the same number, on another day; it reaches further."""
    cloud_of(seen_from_street(), time=90_000.0).write(tmp_path / "street.laz")
    return tmp_path / "street.laz"


def test_points_from_the_street_are_told_in_every_tile(air: Path, street: Path) -> None:
    for tile in tiles([street, air]):
        of_street = tile.source == 0
        np.testing.assert_array_equal(tile.is_from_street, of_street)
        inside = ((tile.points[:, :2] > 0.0) & (tile.points[:, :2] < 60.0)).all(axis=1)
        assert (tile.view[of_street & inside] == View.COVERED).all()
        assert (tile.view[~of_street] == View.ABOVE).all()
        if inside.mean() > 0.5:  # the tile's spacing is that of what tells its roofs
            assert tile.point_spacing == pytest.approx(8.0**-0.5, rel=0.1)


def test_what_was_seen_from_above_alone_has_no_views(air: Path) -> None:
    assert all(tile.view is None for tile in tiles([air]))


def test_what_a_vehicle_saw_changes_no_intensity_of_the_others(air: Path, street: Path) -> None:
    def intensities(paths: list[Path], number: int) -> dict[int, float]:
        own = [tile.select((tile.source == number) & tile.is_core) for tile in tiles(paths)]
        pairs = (zip(one.index.tolist(), one.normalised_intensity.tolist(), strict=True) for one in own)
        return {index: value for each in pairs for index, value in each}

    alone = intensities([air], 0)

    assert len(alone) == 8 * 60**2
    assert intensities([street, air], 1) == alone


def test_a_parameter_says_from_where_all_was_seen(air: Path, street: Path) -> None:
    assert all(tile.view is None for tile in tiles([air, street], view="above"))
    assert all((tile.view == View.STREET).all() for tile in tiles([air, street], view="street"))


def test_what_poses_told_is_kept_in_files(tmp_path: Path) -> None:
    points, path = seen_from_above(), tmp_path / "placed.laz"
    file = PlacedLaz(path)
    view = np.where(points[:, 0] < 30.0, View.STREET, View.ABOVE).astype(np.uint8)
    file.add(PlacedScan(points, np.full(len(points), 10**18), {"view": view}))
    file.close()

    assert "View" in laspy.open(path).header.point_format.dimension_names
    np.testing.assert_array_equal(read_tile(path).is_from_street, view == View.STREET)
    for tile in tiles([path]):
        np.testing.assert_array_equal(tile.is_from_street, tile.points[:, 0] < 30.0)
