"""Table 1 of Sampath & Shan: σ and largest offset of ten buildings each, over the point spacing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.tables import table
from bench.outlines.chain import Building, chain_of
from bench.outlines.clouds import RoofCloud, read_roofs
from bench.outlines.truth import tile_of
from bench.scenes.outlines import PLANS, Scan, outline_scene
from lidar_buildings.pipeline.config import PipelineConfig

#: Buildings per data set, as in the paper.
N_BUILDINGS = 10
#: Buildings parallel to the scan lines, as most of the paper's are, and with three of ten "several up to 45
#: degrees" askew [deg].
PARALLEL = (0.0,) * N_BUILDINGS
SOME_ASKEW = (*PARALLEL[:7], 7.0, 22.0, 45.0)
#: GPS time of a virtual survey's first pulse, and between pulses on roofs [s].
FIRST_TIME, PULSE = 1000.0, 1e-5
#: Real clouds, the first of a city of the paper; and the height noise of the virtual surveys [m].
CLOUDS, NOISE = ("toronto", "fusa", "delft"), 0.03
#: A building is cut by the cloud's edge if it comes so near to it [spacings].
CUT = 3.0
#: The paper: data → spacing, mean largest offset [m]; of σ the text says 18 to 21 % of the spacing.
PAPER = {"Baltimore": (2.7, 2.4), "Toronto": (1.2, 1.1), "Purdue campus": (1.0, 1.2)}
PAPER_SIGMA = (0.18, 0.21)


class Adjustment(NamedTuple):
    """Means over buildings with straight or curved walls; NaN if there are none."""

    n_buildings: int
    n_as_traced: int  #: left out
    spacing: float  #: [m]
    max_offset: float  #: [m]
    sigma: float  #: root of the mean variance, as in the paper [m]


class Row(NamedTuple):
    """A line of the table."""

    name: str  #: of the data
    buildings: list[Building]  #: at most ten
    score: Adjustment  #: their means


def row_of_cloud(cloud: RoofCloud, configs: PipelineConfig) -> Row:
    """Take the ten largest buildings of a cloud that its edge does not cut."""
    chain = chain_of(cloud.roofs, configs)
    whole = [one for one in chain.buildings if not _is_cut(cloud, cloud.roofs.points[one.rows], one.spacing)]
    largest = sorted(whole, key=lambda one: -one.outline.area)[:N_BUILDINGS]
    return _row(cloud.name, largest)


class Survey(NamedTuple):
    """How virtual buildings are scanned."""

    spacing: float  #: 1/√density [m]
    ratio: float  #: spacing across the scan lines over that along them
    jitter: float = 0.1  #: largest deviation from a regular pattern [cells]
    has_time: bool = True  #: whether points have GPS time
    rotations: tuple[float, ...] = PARALLEL  #: of the buildings against the lines [deg]
    seeds: tuple[int, ...] = (0,)

    @property
    def name(self) -> str:
        """A line's heading."""
        return f"virtual, {self.spacing:g} m, lines × {self.ratio:g}"


#: Those of the paper: spacing, and the ratio of those across and along the scan lines.
SURVEYS = (Survey(2.7, 1.6), Survey(1.2, 1.5), Survey(1.0, 1.2))


def largest_plans() -> list[str]:
    """Name the ten largest rectilinear plans: dozens of metres long, as in the paper."""
    plans = {name: plan() for name, plan in PLANS.items()}
    rectilinear = [name for name, plan in plans.items() if plan.kind == "rectilinear"]
    return sorted(rectilinear, key=lambda name: -plans[name].polygon.area)[:N_BUILDINGS]


def row_of_survey(survey: Survey, configs: PipelineConfig, *, noise: float = NOISE) -> Row:
    """Scan the ten largest rectilinear plans, from points to outlines."""
    scans = [Scan(0.0, survey.ratio, survey.jitter)]
    buildings = []
    for seed in survey.seeds:
        for name, rotation in zip(largest_plans(), survey.rotations, strict=True):
            scene = outline_scene(
                name,
                density=survey.spacing**-2,
                noise=noise,
                rotation_deg=rotation,
                seed=seed,
                scans=scans,
            )
            tile = tile_of(scene)
            if survey.has_time:
                tile = tile.with_columns(gps_time=FIRST_TIME + PULSE * np.arange(len(tile.points)))
            found = chain_of(tile, configs).buildings
            buildings += sorted(found, key=lambda one: -one.outline.area)[:1]
    return _row(survey.name, buildings)


def report(data: Path, configs: PipelineConfig, *, noise: float = NOISE, seed: int = 0) -> list[Row]:
    """Print the paper's lines, those of the real clouds that are there, and those of virtual surveys."""
    files = {name: sorted((data / name).glob("*.laz")) for name in CLOUDS}
    rows = [row_of_cloud(read_roofs(name, paths), configs) for name, paths in files.items() if paths]
    rows += [row_of_survey(one._replace(seeds=(seed,)), configs, noise=noise) for one in SURVEYS]
    print(table_1(rows))
    for figure, title in (("sigma", "σ"), ("max_offset", "largest offset")):
        slope, deviation = slope_through_origin(rows, figure)
        print(f"{title} = {slope:.3f} · spacing, to {100 * deviation:.0f} %")
    print()
    return rows


def table_1(rows: Sequence[Row]) -> str:
    """Return the paper's lines and ours."""
    low, high = (100 * share for share in PAPER_SIGMA)
    paper = [
        [f"paper: {name}", "10", "", *_lengths(spacing, offset), "", f"{low:.0f}–{high:.0f} %"]
        for name, (spacing, offset) in PAPER.items()
    ]
    ours = [_cells(row) for row in rows]
    headings = ("data", "buildings", "as traced", "spacing [m]", "largest offset [m]", "/ spacing")
    return table((*headings, "σ [m]", "/ spacing"), [*paper, *ours])


def slope_through_origin(rows: Sequence[Row], figure: str) -> tuple[float, float]:
    """Fit figure = slope · spacing; return the slope and the largest deviation as a share of the figure."""
    spacing = np.array([row.score.spacing for row in rows])
    value = np.array([getattr(row.score, figure) for row in rows])
    slope = float(spacing @ value / (spacing @ spacing))
    return slope, float(np.max(np.abs(slope * spacing / value - 1)))


def _row(name: str, buildings: list[Building]) -> Row:
    """Average some buildings; those that kept their traced outline count as such."""
    regular = [one for one in buildings if one.is_regular]
    means = np.mean(
        [(one.spacing, one.max_offset, one.sigma**2) for one in regular] or [(np.nan,) * 3], axis=0
    )
    spacing, offset, sigma = float(means[0]), float(means[1]), float(np.sqrt(means[2]))
    return Row(
        name, buildings, Adjustment(len(regular), len(buildings) - len(regular), spacing, offset, sigma)
    )


def _cells(row: Row) -> list[str]:
    score = row.score
    return [
        row.name,
        str(score.n_buildings),
        str(score.n_as_traced),
        *_lengths(score.spacing, score.max_offset),
        f"{score.sigma:.3f}",
        f"{100 * score.sigma / score.spacing:.1f} %",
    ]


def _lengths(spacing: float, max_offset: float) -> list[str]:
    """Write spacing and largest offset, and the second in units of the first."""
    return [f"{spacing:.2f}", f"{max_offset:.2f}", f"{max_offset / spacing:.2f}"]


def _is_cut(cloud: RoofCloud, points: NDArray[np.float64], spacing: float) -> bool:
    """Whether a building's points come near to the edge of the cloud."""
    low, high = cloud.extent
    inner = shapely.box(*(low + CUT * spacing), *(high - CUT * spacing))
    return not bool(np.all(shapely.intersects_xy(inner, points[:, 0], points[:, 1])))
