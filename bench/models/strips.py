"""
How corners of a town get better, and their σ with them, as it is flown over again.

    python -m bench.models.strips [--scene NAME] [--seeds N ...] [--density D] [--set STAGE.NAME=VALUE ...]
                                  [--live]

Each flight crosses the whole scene in a direction of its own; a live survey makes a tile again when more
points have come, of all its points, as here. A line per number of flights: the points, the buildings with a
model, corners of LoD2.2 matched with the truth within 1 m, the medians of their errors and of their standard
deviations in plan (along one axis) and in height, and the shares of errors within one and two of these.

With --live the flights are scans for `lidar-buildings live`, in processes of its own. After each flight there
are two lines: of the models that were solved again from sums (`provisional`), and of those made again of all
points, each with the seconds from the flight's last point; processor seconds are of all the graph's work.
Are the files in the end those that `run` makes of the flights?
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.arguments import config_of
from bench.common.tables import table
from bench.models.precision import matched_corners
from bench.scenes.models import solid_of
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.evaluation.scores.models import roof_wireframe
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.simulation import make_scene, simulate_tile
from lidar_buildings.simulation.scene import VirtualScene

#: Directions of the flights, counter-clockwise from east [deg].
DIRECTIONS = (0.0, 90.0, 45.0, 135.0)
HEADINGS = (
    "models", "corners", "xy error [m]", "xy σ [m]", "z error [m]", "z σ [m]", "x, y: 1σ %", "2σ %",
    "z: 1σ %", "2σ %",
)  # fmt: skip
#: Time between two flights [s].
TURN = 30.0


def flights_of(scene: VirtualScene, seed: int, density: float) -> Iterator[PointTile]:
    """Yield the points of each flight, in whole millimetres, with strips and times of their own."""
    start = 0.0
    for number, direction in enumerate(DIRECTIONS):
        own = seed * len(DIRECTIONS) + number
        flight, _ = simulate_tile(scene, own, density=density, flight_direction_deg=direction)
        times, strips = flight.gps_time, flight.point_source_id
        assert times is not None
        assert strips is not None
        start = start or float(times.min())
        times = times - times.min() + start
        start = float(times.max()) + TURN
        flight = replace(flight, points=flight.points.round(3))
        yield flight.with_columns(gps_time=times, point_source_id=strips + 10 * number)


def after_each_flight(scene: VirtualScene, seed: int, density: float) -> Iterator[PointTile]:
    """Yield all points measured so far."""
    flights: list[PointTile] = []
    for flight in flights_of(scene, seed, density):
        flights.append(flight)
        points = np.concatenate([one.points for one in flights])
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(one, name) for one in flights]) for name in flights[0].columns
        }
        columns["index"] = np.arange(len(points))
        spacing = steady_spacing(points, None)
        yield PointTile(points, stamp=flights[0].stamp, point_spacing=spacing, frame=scene.frame, **columns)


def cells_of(models: Sequence[BuildingModel], scene: VirtualScene) -> list[str]:
    """Return the figures of the corners of models in the order of the headings."""
    true = np.concatenate([roof_wireframe([solid_of(one)]).corners for one in scene.buildings])
    corners = matched_corners(models, true)
    error, sigma = np.abs([one.error for one in corners]), np.array([one.sigma for one in corners])
    medians = [np.median(one[:, axes]) for axes in (slice(2), 2) for one in (error, sigma)]
    within = [
        np.mean(error[:, axes] <= k * sigma[:, axes]) for axes in (slice(2), slice(2, 3)) for k in (1, 2)
    ]
    return [
        str(sum(bool(model.solids) for model in models)),
        str(len(error)),
        *(f"{one:.3f}" for one in medians),
        *(f"{100 * one:.0f}" for one in within),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each seed and number of flights."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default="village")
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12])
    parser.add_argument("--density", type=float, default=2.0, help="pulses of each flight [1/m²]")
    parser.add_argument(
        "--set", nargs="+", default=["regularisation.correct_bias=true"], metavar="STAGE.NAME=VALUE"
    )
    parser.add_argument("--live", action="store_true", help="through the live graph")
    options = parser.parse_args(arguments)
    config = config_of(options.set)
    rows, told = [], []
    for seed in options.seeds:
        scene = make_scene(options.scene, seed)
        if options.live:
            flights = list(flights_of(scene, seed, options.density))
            own, said = live_rows(flights, scene, options.set)
            rows += [[str(seed), *row] for row in own]
            told.append(f"seed {seed}: {said}")
            continue
        for number, tile in enumerate(after_each_flight(scene, seed, options.density), start=1):
            models = [one.model for one in reconstruct_tile(tile, config).models]
            rows.append([str(seed), str(number), f"{len(tile):,}", *cells_of(models, scene)])
    of_live = ("flight", "model", "after [s]", "cpu [s]")
    print(table(("seed", *(of_live if options.live else ("flights", "points")), *HEADINGS), rows))
    print(*told, sep="\n")


def live_rows(
    flights: Sequence[PointTile], scene: VirtualScene, settings: Sequence[str]
) -> tuple[list[list[str]], str]:
    """Return two lines for each flight, and what is to be said of the files."""
    from bench.models.live_strips import are_equal, flown, model_of, run_on  # needs ROS

    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number, found in enumerate(flown(flights, scene.frame, folder / "live", settings), start=1):
            kinds = (("solved", found.solved, found.solved_after), ("made", found.made, found.made_after))
            for kind, lines, after in kinds:
                if lines:
                    cells = cells_of([model_of(one) for one in lines.values()], scene)
                    rows.append([str(number), kind, f"{after:.1f}", f"{found.cpu:.1f}", *cells])
        run_on(flights, scene.frame, folder / "run", settings)
        is_same = are_equal(folder / "live", folder / "run")
    return rows, f"files {'equal' if is_same else 'differ from'} those of run"


if __name__ == "__main__":
    main()
