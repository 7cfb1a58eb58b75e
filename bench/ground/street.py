"""
Ground seen by a spinning scanner on a vehicle: virtual drives, a real one, and what a scan costs.

    python -m bench.ground.street [--seeds 11 12 13] [--scenes village] [--scans 80] [--data DIR]
                                  [--pictures DIR] [--parts virtual real cost]

`street` is what a run does with points from the street, all scans of a drive as one tile; `airborne` is the
filter of points from above on the same; `patchwork++` (Lee, Lim & Myung 2022) takes scan after scan where
`pypatchworkpp` is installed. Virtual: F1 of the ground by range. Real: against the surface of the merged
scans, the 5th percentile of cells of 0.5 m and its median over 3 m, which share of the points more than 0.3 m
above it is called ground, and which share of those within 0.15 m is not. Beyond some 15 m that surface runs
through hedges, and through walls behind glass. Cost: processor time, and that divided by the scans.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.common.arguments import add_pictures, data_parser, picture_folder
from bench.common.clouds import data_folder
from bench.common.tables import percent, table
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.evaluation.scores.cells import RESULT_GROUND
from lidar_buildings.io.bags.bag import CLOUD, ODOMETRY, Bag
from lidar_buildings.simulation import make_scene
from lidar_buildings.simulation.live import Scan, VehicleConfig, drive

#: Highest and lowest beam of the virtual scanners, in degrees.
BEAMS = {"to +2°": (2.0, -24.9), "to +20°": (20.0, -25.0)}
#: Limits of the bands of range [m], and ranges up to which the real drive is judged.
BANDS, REAL_RANGES = (0, 10, 20, 30, 40), (15, 40, 500)
#: The reference surface: cells, share of their points below it, window of its median in cells.
CELL, LOW_SHARE, WINDOW = 0.5, 0.05, 7
#: Above it by more is an object, nearer to it is ground [m].
OBJECT, GROUND = 0.3, 0.15
#: How high the scanner stands [m]: virtual, and real as its own ground shows.
VIRTUAL_MAST, REAL_MAST = 1.95, 1.73


class Drive(NamedTuple):
    """A drive's points, scan after scan."""

    points: NDArray[np.float64]  #: in the map, rounded to float32 as in a run [m], shape (n_points, 3)
    sensor: NDArray[np.float32]  #: as the scanner measured them [m], shape (n_points, 3)
    first: NDArray[np.intp]  #: where each scan begins, and the end
    mast: float  #: height of the scanner [m]

    @property
    def range(self) -> NDArray[np.float32]:
        """Distance of each point from the scanner [m]."""
        return np.asarray(np.linalg.norm(self.sensor, axis=1))


def virtual_drive(
    scene: str, seed: int, beams: tuple[float, float], n_scans: int
) -> tuple[Drive, NDArray[np.bool_]]:
    """Return a drive of so many scans through a scene, from its first leg's middle, and its true ground."""
    high, low = beams
    survey = drive(make_scene(scene, seed), seed, VehicleConfig(highest_deg=high, lowest_deg=low))
    first_leg = int(survey.legs[0].duration * 10.0)
    begin = max((first_leg - n_scans) // 2, 0)
    points, sensor, is_ground = [], [], []
    for number, event in enumerate(event for event in survey.events() if isinstance(event, Scan)):
        if number >= begin + n_scans:
            break
        if number >= begin:
            rows = event.rows[event.rows["range"] > 0]
            points.append(event.truth.points)
            sensor.append(np.column_stack([rows[name] for name in "xyz"]))
            is_ground.append(event.truth.true_class == 2)
    return _drive_of(points, sensor, VIRTUAL_MAST), np.concatenate(is_ground)


def real_drive(folder: Path) -> Drive:
    """Return a bag's scans, placed by its odometry; points without a place or of the vehicle are left out."""
    poses, scans = {}, []
    with Bag(folder) as bag:
        for _, kind, _, message in bag.messages([topic.name for topic in bag.topics]):
            stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
            if kind == ODOMETRY:
                place, turn = message.pose.pose.position, message.pose.pose.orientation
                poses[stamp] = ([place.x, place.y, place.z], [turn.x, turn.y, turn.z, turn.w])
            elif kind == CLOUD:
                rows = np.frombuffer(message.data, np.uint8).reshape(-1, message.point_step)
                scans.append((stamp, np.ascontiguousarray(rows[:, :12]).view("<f4")))
    points, sensor = [], []
    for stamp, xyz in scans:
        place, turn = poses[stamp]
        own = xyz[np.isfinite(xyz).all(axis=1) & (np.linalg.norm(xyz, axis=1) > 0.5)]
        points.append(Rotation.from_quat(turn).apply(own) + place)
        sensor.append(own)
    return _drive_of(points, sensor, REAL_MAST)


def _drive_of(points: Sequence[NDArray], sensor: Sequence[NDArray], mast: float) -> Drive:
    first = np.concatenate(([0], np.cumsum([len(one) for one in points]))).astype(np.intp)
    placed = np.concatenate(points).astype(np.float32).astype(np.float64)
    return Drive(placed, np.concatenate(sensor).astype(np.float32), first, mast)


def merged(one: Drive, *, from_street: bool) -> NDArray[np.bool_]:
    """Return the ground of all scans as one tile."""
    street = np.full(len(one.points), from_street)
    return np.isin(classify_ground(one.points, from_street=street).classification, RESULT_GROUND)


def patchwork(one: Drive) -> NDArray[np.bool_]:
    """Return the ground that Patchwork++ finds in each scan by itself."""
    import pypatchworkpp

    parameters = pypatchworkpp.Parameters()
    parameters.sensor_height = one.mast
    parameters.enable_RNR = False  # it asks for intensities
    method, ground = pypatchworkpp.patchworkpp(parameters), np.zeros(len(one.points), dtype=bool)
    for begin, end in pairwise(one.first):
        method.estimateGround(one.sensor[begin:end])
        ground[begin + np.asarray(method.getGroundIndices(), dtype=np.intp)] = True
    return ground


def methods() -> dict[str, Callable[[Drive], NDArray[np.bool_]]]:
    """Return what is there, by name."""
    found: dict[str, Callable[[Drive], NDArray[np.bool_]]] = {
        "street": partial(merged, from_street=True),
        "airborne": partial(merged, from_street=False),
    }
    try:
        import pypatchworkpp  # noqa: F401
    except ImportError:
        print("patchwork++ is left out: pip install pypatchworkpp")
    else:
        found["patchwork++"] = patchwork
    return found


def f1_by_range(one: Drive, is_ground: NDArray[np.bool_], found: NDArray[np.bool_]) -> list[str]:
    """Return F1 of the ground, of all and in each band."""
    cells, away = [], one.range
    for low, high in ((0.0, np.inf), *pairwise(BANDS)):
        rows = (away >= low) & (away < high)
        both = np.count_nonzero(rows & is_ground & found)
        each = np.count_nonzero(rows & is_ground) + np.count_nonzero(rows & found)
        cells.append(f"{2 * both / each:.3f}" if each else "–")
    return cells


def reference_height(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far points lie above the surface of the merged scans [m]."""
    place = np.floor(points[:, :2] / CELL).astype(np.int64)
    place -= place.min(axis=0)
    shape = place.max(axis=0) + 1
    number = place[:, 0] * shape[1] + place[:, 1]
    rows, first = rows_by_group(number, int(shape.prod()))
    low = np.full(int(shape.prod()), np.nan)
    for k in np.flatnonzero(np.diff(first)):
        own = points[rows[first[k] : first[k + 1]], 2]
        low[k] = np.partition(own, nth := int(LOW_SHARE * (len(own) - 1)))[nth]
    low = np.pad(low.reshape(shape), WINDOW // 2, constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(low, (WINDOW, WINDOW)).reshape(int(shape.prod()), -1)
    taken = np.unique(number)
    surface = np.full(int(shape.prod()), np.nan)
    surface[taken] = np.nanmedian(around[taken], axis=1)
    return np.asarray(points[:, 2] - surface[number])


def virtual_rows(scenes: Sequence[str], seeds: Sequence[int], n_scans: int) -> list[list[str]]:
    """Return F1 by scene, scanner, seed and method."""
    rows = []
    for scene in scenes:
        for name, beams in BEAMS.items():
            for seed in seeds:
                one, is_ground = virtual_drive(scene, seed, beams, n_scans)
                for method, run in methods().items():
                    rows.append([method, scene, name, str(seed), *f1_by_range(one, is_ground, run(one))])
    return rows


def real_rows(one: Drive, pictures: Path | None) -> list[list[str]]:
    """Return by method, up to each range, objects called ground and ground missed [%]."""
    height, away, rows = reference_height(one.points), one.range, []
    for method, run in methods().items():
        found = run(one)
        row = [method]
        for reach in REAL_RANGES:
            is_object = (height > OBJECT) & (away < reach)
            is_ground = (np.abs(height) <= GROUND) & (away < reach)
            row += [percent(float(found[is_object].mean())), percent(float((~found[is_ground]).mean()))]
        rows.append(row)
        if pictures is not None:
            _draw(pictures / f"street_{method}.png", one.points, height, found)
    return rows


def _draw(path: Path, points: NDArray[np.float64], height: NDArray[np.float64], found: NDArray) -> None:
    """Draw the drive: ground grey, the rest blue, objects called ground red, ground missed orange."""
    from bench.common.plotting import plt

    figure, axes = plt.subplots(figsize=(16, 16), dpi=80, layout="constrained")
    groups = (
        ("0.8", found),
        ("tab:blue", ~found),
        ("tab:orange", ~found & (np.abs(height) <= GROUND)),
        ("red", found & (height > OBJECT)),
    )
    for colour, chosen in groups:
        axes.plot(*points[np.flatnonzero(chosen)[::3], :2].T, ",", color=colour)
    axes.set(aspect="equal", xlim=(-45, 45), ylim=(-45, 45))
    figure.savefig(path)
    plt.close(figure)


def cost_rows(one: Drive, repeats: int = 5) -> list[list[str]]:
    """Return the processor time of a scan [ms]: by itself, and as its part of all as one tile."""
    alone = Drive(one.points[: one.first[1]], one.sensor[: one.first[1]], one.first[:2], one.mast)
    rows = []
    for method, run in methods().items():
        row = [method]
        for scans in (alone, one):
            run(scans)
            spent = []
            for _ in range(repeats):
                begin = time.process_time()
                run(scans)
                spent.append(time.process_time() - begin)
            row.append(f"{1000.0 * min(spent) / (len(scans.first) - 1):.0f}")
        rows.append(row)
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = data_parser(__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12, 13])
    parser.add_argument("--scenes", nargs="+", default=["village"])
    parser.add_argument("--scans", type=int, default=80, help="of each virtual drive")
    parts = ("virtual", "real", "cost")
    parser.add_argument("--parts", nargs="+", choices=parts, default=parts)
    add_pictures(parser)
    options = parser.parse_args(arguments)
    if "virtual" in options.parts:
        headings = ("F1", "scene", "beams", "seed", "all", "0–10 m", "10–20", "20–30", "30–40")
        print(table(headings, virtual_rows(options.scenes, options.seeds, options.scans)))
    folder = data_folder(options.data) / "drive"
    if not {"real", "cost"} & set(options.parts):
        return
    if not folder.exists():
        raise SystemExit(f"{folder}: does not exist: give the data folder with --data")
    one = real_drive(folder)
    if "real" in options.parts:
        headings = [f"{what}, {reach} m" for reach in REAL_RANGES for what in ("called ground %", "missed %")]
        print(table(("real", *headings), real_rows(one, picture_folder(options.pictures))))
    if "cost" in options.parts:
        print(table(("ms a scan", "one scan", f"{len(one.first) - 1} as a tile"), cost_rows(one)))


if __name__ == "__main__":
    main()
