"""Points of bags laid beside clouds: by their system, by an offset, or by what both show."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.bags.beside_clouds import Beside, lay_beside
from lidar_buildings.io.clouds.las import open_cloud

#: Where the clouds lie in EPSG:32632 [m].
PLACE = np.array([500_000.0, 5_400_000.0, 200.0])
BAG = Path("drive")


def saved(path: Path, points: NDArray[np.float64], crs: str = "") -> Path:
    """Write points, with a dimension of their own."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_extra_dim(laspy.ExtraBytesParams("View", "uint8"))
    header.scales, header.offsets = [0.001] * 3, np.floor(points[0])
    if crs:
        header.add_crs(pyproj.CRS(crs))
    cloud = laspy.LasData(header)
    cloud.xyz = points
    cloud.gps_time, cloud["View"] = np.arange(len(points), dtype=float), np.full(len(points), 2)
    cloud.write(path)
    return path


def ground(seed: int = 0) -> NDArray[np.float64]:
    """Return ground of 40 × 40 m [m]."""
    plan = np.random.default_rng(seed).uniform(0.0, 40.0, (20_000, 2))
    return np.column_stack([plan, 0.01 * plan[:, 0]])


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """A cloud in a reference system."""
    return [saved(tmp_path / "tile.laz", ground() + PLACE, "EPSG:32632")]


def beside(path: Path, files: list[Path], **choice: str | bool) -> Beside:
    """Lay a file beside others."""
    return lay_beside(BAG, path, [open_cloud(one) for one in files], BagConfig(**choice))


def test_an_offset_places_local_points_in_the_system_of_the_files(tmp_path: Path, files: list[Path]) -> None:
    local = ground(1)
    turned = np.column_stack([local[:, 1], -local[:, 0], local[:, 2]])  # its frame is turned by 90°
    path = saved(tmp_path / "drive.laz", turned)

    found = beside(path, files, offset="500000,5400000,200,90")

    cloud = laspy.read(path)
    np.testing.assert_allclose(cloud.xyz, local + PLACE, atol=0.002)
    assert (cloud["View"] == 2).all()
    assert open_cloud(path).crs.name == open_cloud(files[0]).crs.name
    assert not found.warning


def test_points_of_another_system_are_transformed(tmp_path: Path, files: list[Path]) -> None:
    x, y = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:32633", always_xy=True).transform(
        *(ground(1) + PLACE).T[:2]
    )
    path = saved(tmp_path / "drive.laz", np.column_stack([x, y, ground(1)[:, 2] + 200.0]), "EPSG:32633")

    beside(path, files)

    np.testing.assert_allclose(laspy.read(path).xyz, ground(1) + PLACE, atol=0.002)


def test_heights_of_another_system_are_told_of_and_aligned(tmp_path: Path, files: list[Path]) -> None:
    path = saved(tmp_path / "drive.laz", ground(1) + PLACE + (0.0, 0.0, 47.3), "EPSG:32632")

    assert "+47.30 m above" in beside(path, files).warning
    found = beside(path, files, align=True)

    assert found.alignment is not None
    assert found.alignment["z"] == pytest.approx(-47.3, abs=0.02)
    assert "only heights" in found.warning
    np.testing.assert_allclose(laspy.read(path).z, ground(1)[:, 2] + 200.0, atol=0.05)


def test_points_that_nothing_places_are_refused(tmp_path: Path, files: list[Path]) -> None:
    path = saved(tmp_path / "drive.laz", ground(1))

    with pytest.raises(InputError, match="km from those of the files"):
        beside(path, files)
    with pytest.raises(ParameterError, match="four numbers"):
        beside(path, files, offset="1,2,3")
