"""How fast planes and models come, and that two runs give the same bytes."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bench.common.tables import table
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints import Footprints
from lidar_buildings.pipeline.reconstruct import PipelineConfig, TileResult, reconstruct_tile
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.pipeline.tile_stages import fit_planes

HEADINGS = (
    *("buildings", "roof points", "planes [s]", "models [s]", "buildings/s", "CPU [s]"),
    *("same bytes", "in any order"),
)


class Speed(NamedTuple):
    """
    Times of the two stages on one tile.

    Attributes
    ----------
    name : str
    n_buildings, n_points : int
    planes, models : float
        Least wall time of the repeats [s].
    processor : float
        Least processor time of both stages, of all threads [s]; it tells more where others work beside.
    is_repeatable, is_free_of_order : bool
        Whether all repeats gave the same solids, and points in another order, too.
    """

    name: str
    n_buildings: int
    n_points: int
    planes: float
    models: float
    processor: float
    is_repeatable: bool
    is_free_of_order: bool

    @property
    def per_second(self) -> float:
        """Buildings per second of both stages together."""
        return self.n_buildings / (self.planes + self.models)


def speed_of(name: str, tile: PointTile, repeats: int, footprints: Footprints | None = None) -> Speed:
    """Take a tile of raw points to outlines, then planes and models as often as asked for."""
    config = PipelineConfig()
    before = reconstruct_tile(tile, config, until="regularisation", footprints=footprints)
    first = _run(before, before.roofs, config)
    runs = [_run(before, before.roofs, config) for _ in range(repeats)]
    order = np.random.default_rng(0).permutation(len(before.roofs))
    shuffled = _run(before, before.roofs.select(order), config)
    return Speed(
        name,
        len(before.outlines),
        int(np.count_nonzero(before.roofs.building_id)),
        planes=min(run.planes for run in runs),
        models=min(run.models for run in runs),
        processor=min(run.processor for run in runs),
        is_repeatable={run.digest for run in runs} == {first.digest},
        is_free_of_order=shuffled.digest == first.digest,
    )


def fingerprint(models: Sequence[TileModel]) -> str:
    """Return a digest of all vertices and faces of all models."""
    digest = hashlib.sha256()
    for one in models:
        for level in sorted(one.model.solids):
            solid = one.model.solids[level]
            digest.update(f"{one.building_id} {level} {solid.faces}".encode())
            digest.update(np.ascontiguousarray(solid.vertices).tobytes())
    return digest.hexdigest()


def speed_table(speeds: Sequence[Speed]) -> str:
    """Return a line per tile."""
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
                f"{one.processor:.2f}",
                "yes" if one.is_repeatable else "NO",
                "yes" if one.is_free_of_order else "NO",
            ]
            for one in speeds
        ),
    )


class _Run(NamedTuple):
    """Seconds of one run of both stages, and a digest of what it gave."""

    planes: float
    models: float
    processor: float
    digest: str


def _run(before: TileResult, roofs: PointTile, config: PipelineConfig) -> _Run:
    """Fit planes and build models of a tile whose outlines are there."""
    started, used = time.perf_counter(), time.process_time()
    fitted = fit_planes(roofs, config.plane_fitting)
    between = time.perf_counter()
    models = build_models(fitted, before.outlines, config.building_model)
    ended = time.perf_counter()
    return _Run(between - started, ended - between, time.process_time() - used, fingerprint(models))
