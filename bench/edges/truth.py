"""
Edge labels against the exact outlines of simulated roofs: a reference that no empty disc has a part in.

    python -m bench.edges.truth [--scenes NAME ...] [--density D ...] [--methods METHOD ...]
                                  [--set NAME=VALUE ...] [--variants VARIANT ...]

The alpha shape that `bench.edges.run` takes for reference is found by the disc that thins the labels. Here
the outlines of roofs are known. Points nearer than half a spacing to one should be edges (completeness), and
edges should lie no further than one spacing from one (correctness).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.areas import RoofArea
from bench.common.arguments import parser_of, settings_of
from bench.common.tables import percent, table
from bench.edges.run import METHODS, VARIANTS, configs_of, label_area
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.evaluation.scores.cells import ratio
from lidar_buildings.evaluation.scores.outlines import merge_touching
from lidar_buildings.simulation import simulate_tile

#: Distances from an outline up to which a point should be an edge, and may be one [spacings].
SHOULD, MAY = 0.5, 1.0
SCENES, DENSITIES = ("village", "roof_types", "courtyards"), (4.0, 12.0)


class OutlineScore(NamedTuple):
    """How labels lie along outlines."""

    completeness: float  #: edges among the points that should be some
    correctness: float  #: points that may be edges among those labelled

    @property
    def f_score(self) -> float:
        """Harmonic mean."""
        return ratio(2 * self.completeness * self.correctness, self.completeness + self.correctness)


def simulated_roofs(scene: str, density: float) -> tuple[RoofArea, NDArray[np.float64]]:
    """Scan a scene; return its roof points without walls, and their distances from the blocks' outlines."""
    tile, truth = simulate_tile(scene, density=density)
    points = np.round(tile.points[truth.plane > 0], 3)  # as a survey's files have them
    outlines = np.array([building.polygon for building in truth.scene.buildings], dtype=object)
    blocks = shapely.union_all(shapely.boundary(merge_touching(outlines)))
    shapely.prepare(blocks)
    distance = shapely.distance(blocks, shapely.points(points[:, :2]))
    return RoofArea(points, np.zeros(len(points), dtype=np.int64), measure_spacing(points), 0), distance


def score_of(edge: NDArray[np.bool_], distance: NDArray[np.float64], spacing: float) -> OutlineScore:
    """Compare labels with the distances of their points from an outline."""
    should, may = distance <= SHOULD * spacing, distance <= MAY * spacing
    return OutlineScore(
        ratio(int((edge & should).sum()), int(should.sum())), ratio(int((edge & may).sum()), int(edge.sum()))
    )


def rows_of(
    configs: Mapping[str, EdgeLabellingConfig], scenes: Sequence[str], densities: Sequence[float]
) -> list[list[str]]:
    """Lines of the table: every method in every scene, and its mean."""
    roofs = {(s, d): simulated_roofs(s, d) for s in scenes for d in densities}
    rows = []
    for method, config in configs.items():
        found = []
        for (scene, density), (area, distance) in roofs.items():
            found.append(score_of(label_area(area, method, config), distance, area.spacing))
            rows.append([method, scene, f"{density:g}", *_cells(*found[-1], found[-1].f_score)])
        means = np.mean([(*score, score.f_score) for score in found], axis=0)
        rows.append([method, "mean", "", *_cells(*means)])
    return rows


def _cells(*shares: float) -> list[str]:
    return [percent(share) for share in shares]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = parser_of(__doc__, tuple(METHODS))
    parser.add_argument("--scenes", nargs="+", default=SCENES, metavar="NAME")
    parser.add_argument("--density", nargs="+", type=float, default=DENSITIES, metavar="D")
    parser.add_argument("--variants", nargs="+", choices=tuple(VARIANTS), default=tuple(VARIANTS))
    options = parser.parse_args(arguments)
    settings = settings_of(options.set, "edge_labelling")
    for variant in options.variants:
        rows = rows_of(configs_of(variant, options.methods, settings), options.scenes, options.density)
        print(f"{variant.capitalize()}:")
        print(table(("method", "scene", "pts/m²", "completeness", "correctness", "F"), rows) + "\n")


if __name__ == "__main__":
    main()
