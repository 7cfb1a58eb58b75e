"""
Flight strips that were shifted by known amounts, laid on each other.

    python -m bench.scans.strips [--scenes SCENE ...] [--seeds 11 12 13] [--densities 2 8] [--data DIR]

Virtual surveys of overlapping strips, each strip shifted at random (σ 0.3 m in plan, 0.1 m in height): how
far the strips still lie apart after the adjustment in plan and height, the largest of all strips; and the
residuals of all pairs before and after, RMS of level and sloping planes. Strips that nothing tells in plan do
not count there. Real: residuals of the provider's strips, before and after.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.common.arguments import data_parser
from bench.common.clouds import data_folder, read_tile
from bench.common.tables import table
from lidar_buildings.core.surfaces.strip_adjustment import Residuals, StripAdjustment, adjust_strips
from lidar_buildings.simulation.survey import simulate_tile

#: Standard deviations of the shifts in x, y and z [m].
SIGMA = np.array([0.3, 0.3, 0.1])
#: Flying height, low for several strips over a scene [m].
ALTITUDE = 120.0
CLOUDS = ("delft", "montpellier", "toronto", "stbarth", "lowdensity")


def virtual_row(scene: str, seed: int, density: float) -> list[str]:
    """Shift the strips of a survey, adjust them, and return what is left [mm]."""
    tile, _ = simulate_tile(scene, seed, density=density, altitude=ALTITUDE)
    numbers, of = np.unique(tile.point_source_id, return_inverse=True)
    given = np.random.default_rng(seed).normal(0.0, 1.0, (len(numbers), 3)) * SIGMA
    found = adjust_strips(tile.points + given[of], tile.point_source_id)
    left = given + found.shift
    told = np.isfinite(found.error)
    off = [left[told[:, k]][:, axes] for k, axes in enumerate((slice(0, 2), slice(2, 3)))]
    largest = [f"{1000 * np.abs(one - one.mean(axis=0)).max():.0f}" if len(one) else "–" for one in off]
    counts = [f"{told[:, 0].sum()} of {len(numbers)}", str(len(found.pairs))]
    return [scene, str(seed), f"{density:g}", *counts, *largest, *residual_cells(found)]


def residual_cells(found: StripAdjustment) -> list[str]:
    """Return the RMS of the planes of all pairs [mm], before and after: level, sloping."""
    cells = []
    for kind in ("level", "sloping"):
        for side in ("before", "after"):
            every: list[Residuals] = [getattr(pair, side) for pair in found.pairs]
            n = np.array([getattr(one, f"n_{kind}") for one in every])
            rms = np.array([getattr(one, f"rms_{kind}") for one in every])
            known = n > 0
            square = np.average(rms[known] ** 2, weights=n[known]) if known.any() else np.nan
            cells.append(f"{1000 * np.sqrt(square):.0f}" if known.any() else "–")
    return cells


def real_rows(data: Path) -> Iterator[list[str]]:
    """Yield what is left of the strips of real surveys."""
    for name in CLOUDS:
        if not any((data / name).glob("*.laz")):
            continue
        tile = read_tile(data / name)[0]
        if tile.point_source_id is None or len(np.unique(tile.point_source_id)) < 2:
            continue
        found = adjust_strips(tile.points, tile.point_source_id)
        largest = [f"{1000 * np.abs(found.shift[:, axes]).max():.0f}" for axes in (slice(0, 2), 2)]
        told = f"{np.isfinite(found.error[:, 0]).sum()} of {len(found.strips)}"
        yield [name, told, str(len(found.pairs)), *largest, *residual_cells(found)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print both tables."""
    parser = data_parser(__doc__)
    parser.add_argument("--scenes", nargs="+", default=["village"], metavar="SCENE")
    parser.add_argument("--seeds", nargs="+", type=int, default=[11, 12, 13], metavar="N")
    parser.add_argument("--densities", nargs="+", type=float, default=[2.0, 8.0], metavar="D")
    options = parser.parse_args(arguments)
    rms = ["level before", "after", "sloping before", "after [mm]"]
    rows = (
        virtual_row(scene, seed, density)
        for scene in options.scenes
        for seed in options.seeds
        for density in options.densities
    )
    headings = ["scene", "seed", "1/m²", "plan told", "pairs", "plan [mm]", "height [mm]", *rms]
    print(table(headings, rows), flush=True)
    print("\nReal surveys, largest shifts:")
    headings = ["cloud", "plan told", "pairs", "plan [mm]", "height [mm]", *rms]
    print(table(headings, real_rows(data_folder(options.data))))


if __name__ == "__main__":
    main()
