"""
Speed of eigenvalue features, and how far libraries agree on them.

    python -m bench.edges.features [--data DIR] [--copies N] [--repeats N]

Roof points of Delft (class 6), or where that is not there of a simulated village. First with a fixed radius,
then with one chosen for each point; last the whole of edge labelling, of which features are a part. All
libraries run in one process on all cores, in turns; the best of the repeats counts, and the time includes the
search for neighbours. Peers that are not installed are named and left out.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.common.arguments import data_parser
from bench.common.clouds import data_folder, read_tile
from bench.common.tables import table
from bench.edges.feature_agreement import differences
from bench.edges.feature_peers import CHOSEN, FIXED, LABELS, OWN, Library, Task, edge_radii, task_of
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.simulation import simulate_tile

#: The scene that stands in for Delft, and its pulses a square metre.
SCENE, DENSITY = "village", 15.0
#: The fixed radius, and the least, the most and the number of those to choose from [spacings].
RADIUS, RADII = 3.0, (1.6, 5.0, 12)
#: Points of the first run, so that everything is loaded and compiled.
WARM_UP = 2000
SPEED_HEADINGS = ("library", "seconds", "min–max", "of it search", "Mpts/s", f"{OWN} is × as fast")
AGREEMENT_HEADINGS = ("library", "feature", "largest difference", "points", "theirs")


class Timing(NamedTuple):
    """Seconds of one run."""

    search: float
    features: float

    @property
    def total(self) -> float:
        """What a user waits for."""
        return self.search + self.features


def roof_points(data: Path | None, density: float = DENSITY) -> tuple[str, NDArray[np.float64]]:
    """Return a name and the points of Delft's class 6, or of a simulated village's roofs."""
    if data is not None and any((data / "delft").glob("*.laz")):
        tile, _ = read_tile(data / "delft")
        return "Delft, class 6", tile.points[tile.classification == PointClass.BUILDING]
    tile, truth = simulate_tile(SCENE, density=density)
    return f"simulated {SCENE}", tile.points[truth.classification == PointClass.BUILDING]


def side_by_side(points: NDArray[np.float64], copies: int) -> NDArray[np.float64]:
    """Return several copies of the points, each beside the last one, too far off to be seen from there."""
    width = np.ceil(np.ptp(points[:, 0])) + 100.0
    return np.concatenate([points + np.array([k * width, 0.0, 0.0]) for k in range(copies)])


def time_one(library: Library, task: Task) -> Timing:
    """Run a library once."""
    start = time.perf_counter()
    neighbours = None if library.search is None else library.search(task)
    found = time.perf_counter()
    library.describe(task, neighbours)
    return Timing(found - start, time.perf_counter() - found)


def time_all(libraries: Mapping[str, Library], task: Task, repeats: int) -> dict[str, list[Timing]]:
    """Run all that are installed, in turns."""
    there = {name: library for name, library in libraries.items() if library.installed}
    small = task_of(task.points[:WARM_UP], task.radii)
    for library in there.values():
        time_one(library, small)
    timings: dict[str, list[Timing]] = {name: [] for name in there}
    for _ in range(repeats):
        for name, library in there.items():
            timings[name].append(time_one(library, task))
    return timings


def speed_rows(
    libraries: Mapping[str, Library], timings: Mapping[str, Sequence[Timing]], n_points: int
) -> list[list[str]]:
    """One line per library."""
    own = min(one.total for one in timings[OWN])
    rows = []
    for name, library in libraries.items():
        if name not in timings:
            rows.append([name, "not installed", *[""] * (len(SPEED_HEADINGS) - 2)])
            continue
        every = [one.total for one in timings[name]]
        best = min(timings[name], key=lambda one: one.total)
        search = "–" if library.search is None else f"{best.search:.3f}"
        speed, ratio = n_points / best.total / 1e6, best.total / own
        span = f"{min(every):.3f}–{max(every):.3f}"
        rows.append([name, f"{best.total:.3f}", span, search, f"{speed:.3f}", f"{ratio:.1f}"])
    return rows


def agreement_rows(task: Task) -> list[list[str]]:
    """One line per library and feature."""
    return [
        [one.library, one.feature, f"{one.largest:.1e}", str(one.n_points), one.remark]
        for name, library in FIXED.items()
        if library.installed
        for one in differences(name, task)
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and compare, and print the tables."""
    options = _parser().parse_args(arguments)
    name, points = roof_points(data_folder(options.data), options.density)
    spacing = quantised_spacing(points)
    points = side_by_side(points, options.copies)
    # A peer takes the radius in float32: one that is the same in both.
    radius = float(np.float32(RADIUS * spacing))
    radii = np.geomspace(*RADII) * spacing
    print(f"{name}: {len(points)} points, spacing {spacing:.3f} m\n")
    fixed, chosen = task_of(points, [radius]), task_of(points, radii)
    print(f"Fixed radius of {radius:.3f} m, at most {fixed.most} neighbours")
    print(table(SPEED_HEADINGS, speed_rows(FIXED, time_all(FIXED, fixed, options.repeats), len(points))))
    print(f"\n{len(radii)} radii from {radii[0]:.3f} to {radii[-1]:.3f} m, at most {chosen.most} neighbours")
    print(table(SPEED_HEADINGS, speed_rows(CHOSEN, time_all(CHOSEN, chosen, options.repeats), len(points))))
    labels = task_of(points, edge_radii(spacing))
    print(
        f"\nEdge labelling, {len(labels.radii)} radii from {labels.radii[0]:.3f} to {labels.radii[-1]:.3f} m"
    )
    print(table(SPEED_HEADINGS, speed_rows(LABELS, time_all(LABELS, labels, options.repeats), len(points))))
    print(f"\nDifferences from {OWN} with the fixed radius")
    print(table(AGREEMENT_HEADINGS, agreement_rows(fixed)))


def _parser() -> argparse.ArgumentParser:
    parser = data_parser(__doc__)
    parser.add_argument("--density", type=float, default=DENSITY, help="pulses/m² of the simulation")
    parser.add_argument("--copies", type=int, default=1, help="of the points, side by side: a larger tile")
    parser.add_argument("--repeats", type=int, default=5, help="rounds, the best of which counts")
    return parser


if __name__ == "__main__":
    main()
