"""
How fast planes and models come, and that two runs give the same bytes.

"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from agreement import table

from lidar_buildings.core.tile import PointTile
from lidar_buildings.core.tile_models import TileModel, build_models
from lidar_buildings.core.tile_stages import fit_planes
from lidar_buildings.pipeline import PipelineConfig, TileResult, reconstruct_tile

HEADINGS = ("buildings", "roof points", "planes [s]", "models [s]", "buildings/s", "same bytes")


class Speed(NamedTuple):
    """
    Times of the two stages on one tile.

    Attributes
    ----------
    name : str
    n_buildings, n_points : int
    planes, models : float
        Least wall time of the repeats [s].
    is_repeatable : bool
        Whether all repeats, one of them with the points in another order, gave the same solids.

    """

    name: str
    n_buildings: int
    n_points: int
    planes: float
    models: float
    is_repeatable: bool

    @property
    def per_second(self) -> float:
        """
        Buildings per second of both stages together.

        """
        return self.n_buildings / (self.planes + self.models)


def speed_of(name: str, tile: PointTile, repeats: int) -> Speed:
    """
    Take a tile of raw points to outlines, then planes and models as often as asked for.

    """
    config = PipelineConfig()
    before = reconstruct_tile(tile, config, until="regularisation")
    _models(before, fit_planes(before.roofs, config.plane_fitting), config)
    planes, models, prints = [], [], set()
    for _ in range(max(repeats, 2)):
        roofs, seconds = _timed(lambda: fit_planes(before.roofs, config.plane_fitting))
        planes.append(seconds)
        built, seconds = _timed(lambda roofs=roofs: _models(before, roofs, config))
        models.append(seconds)
        prints.add(fingerprint(built))
    return Speed(name, len(before.outlines), len(before.roofs), min(planes), min(models), len(prints) == 1)


def fingerprint(models: Sequence[TileModel]) -> str:
    """
    Return a digest of all vertices and faces of all models.

    """
    digest = hashlib.sha256()
    for one in models:
        for level in sorted(one.model.solids):
            solid = one.model.solids[level]
            digest.update(f"{one.building_id} {level} {solid.faces}".encode())
            digest.update(np.ascontiguousarray(solid.vertices).tobytes())
    return digest.hexdigest()


def speed_table(speeds: Sequence[Speed]) -> str:
    """
    Return a line per tile.

    """
    return table(
        ("tile", *HEADINGS),
        (
            [
                one.name,
                str(one.n_buildings),
                str(one.n_points),
                f"{one.planes:.3f}",
                f"{one.models:.3f}",
                f"{one.per_second:.0f}",
                "yes" if one.is_repeatable else "NO",
            ]
            for one in speeds
        ),
    )


def _models(before: TileResult, roofs: PointTile, config: PipelineConfig) -> tuple[TileModel, ...]:
    """
    Build the models of a tile whose outlines are there.

    """
    return build_models(roofs, before.traced, before.outlines, config.building_model, config.regularisation)


def _timed(act: Callable[[], PointTile | tuple[TileModel, ...]]) -> tuple:
    """
    Return what an act gives and the seconds it took.

    """
    start = time.perf_counter()
    given = act()
    return given, time.perf_counter() - start
