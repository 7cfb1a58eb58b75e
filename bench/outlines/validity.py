"""
Whether the outlines of every cloud are valid polygons, how fast they come, and whether neighbours overlap.

What is checked is what a run writes: the stages as the nodes call them, with coordinates as messages carry.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.tables import table
from bench.outlines.clouds import RoofCloud
from lidar_buildings.core.model.outline import Outline, signed_area
from lidar_buildings.pipeline.reconstruct import PipelineConfig
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_stages import trace_buildings

HEADINGS = (
    "classes",
    "points",
    "buildings",
    "holes",
    "invalid",
    "repeated",
    "turned",
    "overlap [m²]",
    "overlaps",
    "s",
    "buildings/s",
)


class Validity(NamedTuple):
    """
    What is wrong with a cloud's outlines.

    Attributes
    ----------
    cloud : RoofCloud
    outlines : list of Outline
    seconds : float
        Least wall time of segmentation, tracing and regularisation.
    """

    cloud: RoofCloud
    outlines: list[Outline]
    seconds: float

    @property
    def polygons(self) -> NDArray[Any]:
        return np.array([shapely.Polygon(one.exterior, one.holes) for one in self.outlines], dtype=object)

    @property
    def n_invalid(self) -> int:
        """Outlines that shapely finds invalid."""
        return int(np.count_nonzero(~shapely.is_valid(self.polygons)))

    @property
    def n_repeated(self) -> int:
        """Outlines with a vertex that occurs twice in a ring."""
        return sum(any(len(np.unique(r, axis=0)) < len(r) for r in one.rings) for one in self.outlines)

    @property
    def n_turned(self) -> int:
        """Outlines whose outer ring is not counter-clockwise or a hole of which is not clockwise."""
        return sum(
            signed_area(one.exterior) <= 0 or any(signed_area(hole) >= 0 for hole in one.holes)
            for one in self.outlines
        )

    def overlaps(self) -> NDArray[np.float64]:
        """Return the areas that two outlines share, pair by pair, where they share any [m²]."""
        polygons = shapely.make_valid(self.polygons)
        one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
        once = one < other
        area = shapely.area(shapely.intersection(polygons[one[once]], polygons[other[once]]))
        return area[area > 0]


def check(cloud: RoofCloud, configs: PipelineConfig, repeats: int = 1) -> Validity:
    """Make a cloud's outlines as a run does, and take the least time of so many runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        traced = trace_buildings(cloud.roofs, configs.segmentation, configs.boundary_tracing)
        outlines = regularise_outlines(traced.outlines, configs.regularisation)
        times.append(time.perf_counter() - start)
    return Validity(cloud, [one.outline for one in outlines], min(times))


def validity_table(checked: Sequence[Validity]) -> str:
    """Return a line per cloud and the sums."""
    return table(("cloud", *HEADINGS), [*(_cells(one) for one in checked), _sums(checked)])


def n_faulty(checked: Sequence[Validity]) -> int:
    """Count what must not be there: invalid outlines, repeated vertices, rings the wrong way round."""
    return sum(one.n_invalid + one.n_repeated + one.n_turned for one in checked)


def _cells(one: Validity) -> list[str]:
    overlaps = one.overlaps()
    return [
        one.cloud.name,
        one.cloud.classes,
        str(len(one.cloud.roofs)),
        str(len(one.outlines)),
        str(sum(len(outline.holes) for outline in one.outlines)),
        str(one.n_invalid),
        str(one.n_repeated),
        str(one.n_turned),
        f"{overlaps.sum():.2f}",
        str(len(overlaps)),
        f"{one.seconds:.2f}",
        f"{len(one.outlines) / one.seconds:.0f}",
    ]


def _sums(checked: Sequence[Validity]) -> list[str]:
    n_outlines, seconds = sum(len(one.outlines) for one in checked), sum(one.seconds for one in checked)
    return [
        "all",
        "",
        str(sum(len(one.cloud.roofs) for one in checked)),
        str(n_outlines),
        str(sum(len(outline.holes) for one in checked for outline in one.outlines)),
        *(
            str(sum(getattr(one, name) for one in checked))
            for name in ("n_invalid", "n_repeated", "n_turned")
        ),
        f"{sum(one.overlaps().sum() for one in checked):.2f}",
        str(sum(len(one.overlaps()) for one in checked)),
        f"{seconds:.2f}",
        f"{n_outlines / seconds:.0f}" if seconds else "–",
    ]
