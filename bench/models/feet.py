"""
Feet of models on level ground and on the terrain: how far off the ground, how many valid, how long it takes.

    python -m bench.models.feet                                villages on 12 slopes, of which all is known
    python -m bench.models.feet --clouds delft fusa stbarth    real clouds: validity and time alone
    python -m bench.models.feet --val3dity PATH                val3dity's verdicts beside ours
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.common.arguments import data_parser
from bench.common.clouds import data_folder, read_tile
from bench.common.tables import table
from bench.models.solids import verdicts
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.solids.shell import GROUND_SURFACE, Solid, ring_edges
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model.config import DRAPED, LEVEL, BuildingModelConfig
from lidar_buildings.pipeline.reconstruct import TileResult, reconstruct_tile
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.simulation.named_scenes import village
from lidar_buildings.simulation.survey import simulate_tile

SLOPES = (10, 20, 30)  #: [%]
#: How far apart the places are at which a foot is compared, and how far off it may be [m].
STEP, MOST_OFF = 1.0, 0.1
#: The stage is timed so often, and the least counts.
REPEATS = 3
#: What reasons say of feet that were cut, and of solids that stay level.
REASONS = ("the foot ends", "stands level")
HEADINGS = (
    *(
        "cloud",
        "foot",
        "places",
        "median off [m]",
        "95 % [m]",
        "in 0.1 m [%]",
        "worst [%]",
        "solids",
        "valid",
    ),
    *("val3dity", "faces", "time", "cut", "left level"),
)

Elevation = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class Feet(NamedTuple):
    """The models of one tile on feet of one kind."""

    models: tuple[TileModel, ...]
    seconds: float  #: of the processor, for the stage

    @property
    def solids(self) -> list[Solid]:
        """The solids of all levels."""
        return [solid for one in self.models for solid in one.model.solids.values()]

    def off(self, ground_at: Elevation) -> NDArray[np.float64]:
        """Return how far above the true ground the finest solids end, at vertices and between [m]."""
        finest = [one.model.solids[max(one.model.solids)] for one in self.models if one.model.solids]
        places = np.concatenate([np.empty((0, 3)), *(foot_places(solid) for solid in finest)])
        return places[:, 2] - ground_at(places[:, :2])


def foot_places(solid: Solid) -> NDArray[np.float64]:
    """Return the vertices of a solid's foot and places every metre between, shape (n, 3) [m]."""
    faces = zip(solid.faces, solid.semantics, strict=True)
    grounds = [face for face, kind in faces if kind == GROUND_SURFACE]
    edges = {edge for face in grounds for ring in face for edge in ring_edges(ring)}
    border = [(a, b) for a, b in edges if (b, a) not in edges]  # others part triangles
    found = [np.empty((0, 3))]
    for start, end in solid.vertices[border]:
        n = max(1, math.ceil(math.dist(start[:2], end[:2]) / STEP))
        found.append(start + np.arange(n)[:, None] / n * (end - start))
    return np.concatenate(found)


def feet_of(found: TileResult, foot: str) -> Feet:
    """Build the models of a tile on feet of a kind, several times for the time."""
    seconds = []
    for _ in range(REPEATS):
        start = time.process_time()
        models = build_models(found.roofs, found.outlines, BuildingModelConfig(foot=foot))
        seconds.append(time.process_time() - start)
    return Feet(models, min(seconds))


def rows_of(
    name: str, tiles: Sequence[PointTile], grounds: Sequence[Elevation | None], val3dity: str | None
) -> Iterator[list[str]]:
    """Yield a row for each kind of foot of some tiles together."""
    found, level_seconds = [reconstruct_tile(tile, until="plane_fitting") for tile in tiles], 0.0
    for foot in (LEVEL, DRAPED):
        feet = [feet_of(one, foot) for one in found]
        seconds, solids = sum(one.seconds for one in feet), [s for one in feet for s in one.solids]
        level_seconds = level_seconds or seconds
        off = [one.off(at) for one, at in zip(feet, grounds, strict=True) if at is not None]
        reasons = [model.attributes["reason"] for one in feet for model in one.models]
        yield [
            *(name, foot, *_shown(off), str(len(solids))),
            str(sum(not check_solid(solid) for solid in solids)),
            str(verdicts(val3dity, solids)[()]) if val3dity else "–",
            str(sum(len(solid.faces) for solid in solids)),
            f"{seconds / level_seconds:.2f}",
            *(str(sum(word in reason for reason in reasons)) for word in REASONS),
        ]


def _shown(off: Sequence[NDArray[np.float64]]) -> list[str]:
    """Return how far feet are off the ground in all tiles, and the least share within 0.1 m of one."""
    if not off:
        return ["–"] * 5
    all_off = np.concatenate(off)
    shares = [100.0 * np.mean(np.abs(one) <= MOST_OFF) for one in (all_off, *off)]
    figures = f"{np.median(all_off):+.2f}", f"{np.quantile(np.abs(all_off), 0.95):.2f}"
    return [str(len(all_off)), *figures, f"{shares[0]:.1f}", f"{min(shares[1:]):.1f}"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = data_parser(__doc__)
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[1, 2, 3, 4], metavar="N", help="of the villages"
    )
    parser.add_argument("--density", type=float, default=6.0, metavar="D", help="of the pulses [1/m²] (6)")
    parser.add_argument(
        "--clouds", nargs="+", default=[], metavar="NAME", help="folders of real clouds instead"
    )
    parser.add_argument("--val3dity", metavar="PATH", help="val3dity, to check the solids as well")
    options = parser.parse_args(arguments)
    rows: list[list[str]] = []
    for name in options.clouds:
        tile, _ = read_tile(data_folder(options.data) / name)
        rows += rows_of(name, [tile], [None], options.val3dity)
    for percent in () if options.clouds else SLOPES:
        turns = np.deg2rad([97.0 * seed for seed in options.seeds])
        slopes = [(percent / 100 * math.cos(turn), percent / 100 * math.sin(turn)) for turn in turns]
        scenes = [village(seed, slope) for seed, slope in zip(options.seeds, slopes, strict=True)]
        tiles = [
            simulate_tile(scene, seed, density=options.density)[0]
            for seed, scene in zip(options.seeds, scenes, strict=True)
        ]
        rows += rows_of(f"slopes of {percent} %", tiles, [one.terrain.at for one in scenes], options.val3dity)
    print(table(HEADINGS, rows))


if __name__ == "__main__":
    main()
