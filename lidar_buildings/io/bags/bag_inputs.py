"""Bags among inputs: their scans are placed first, and then read like any other cloud."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.core.model.parameters import StageConfig, fixed
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.clouds.find_inputs import is_cloud_file
from lidar_buildings.io.files.locations import is_url

#: Why there is nothing of a bag.
NO_SCAN = "no scans within start and duration: check the bag's length with lidar-buildings inspect"


@dataclass(frozen=True)
class BagConfig(StageConfig):
    """What is taken of bags among the inputs."""

    stage: ClassVar[str] = "tile_player"

    topic: str = fixed("", "Topic of the scans of a bag; empty: its only one of clouds.", advanced=True)
    odometry: str = fixed(
        "", "Topic of the poses of a bag; empty: its only one of odometry, else `/tf`.", advanced=True
    )
    start: float = fixed(
        0.0, "A bag is read from so long after its beginning on.", unit="s", within=(0.0, None), advanced=True
    )
    duration: float = fixed(
        0.0, "So much of a bag is read; 0: to its end.", unit="s", within=(0.0, None), advanced=True
    )
    offset: str = fixed(
        "",
        "Where the frame of a bag's poses lies in the reference system of the files beside it: x, y, z [m], "
        "yaw [deg], with commas between them; empty if its own reference system tells.",
        advanced=True,
    )
    align: bool = fixed(
        False,
        "Whether a bag's points are laid on those of the files beside it, from where they are placed: by "
        "ground, roofs and walls that both show.",
        advanced=True,
    )


#: Ending of other files of points → the library that reads them.
LIBRARIES = {".ply": "trimesh", ".pcd": "pypcd4"}
_ENDINGS = (".mcap", ".db3", ".bag")
#: What rosbag2 writes into a bag's folder when it is done.
_METADATA = "metadata.yaml"


def is_bag(path: str | Path) -> bool:
    """Whether a path names a bag here: a folder of rosbag2, or a file."""
    if is_url(path):
        return False
    named = Path(path)
    return (named / _METADATA).is_file() if named.is_dir() else is_bag_file(named)


def is_bag_file(path: Path) -> bool:
    """Whether a file is called as those of bags are, or of points that are made LAZ as those of bags."""
    return path.name.lower().endswith(_ENDINGS) or is_point_file(path)


def is_point_file(path: Path) -> bool:
    """Whether a file is called as PLY and PCD files are, and what reads it is installed."""
    library = LIBRARIES.get(path.suffix.lower())
    return library is not None and find_spec(library) is not None


def bags_of(path: str | Path) -> list[Path]:
    """Return the bags that a path names: itself, or those directly in a folder without clouds, by name."""
    if is_bag(path):
        return [Path(path)]
    has_clouds, bags = _held(path)
    return [] if has_clouds else bags


def bags_among(inputs: Sequence[str]) -> list[Path]:
    """Return the bags among inputs, and in folders among them, each once."""
    return list(dict.fromkeys(bag.resolve() for one in inputs for bag in bags_of(one)))


def bags_beside_clouds(path: str | Path) -> list[Path]:
    """Return the bags directly in a folder of which the clouds alone are taken, by name."""
    has_clouds, bags = _held(path)
    return bags if has_clouds and not is_bag(path) else []


def _held(path: str | Path) -> tuple[bool, list[Path]]:
    """Return whether clouds lie directly in a folder, and the bags that do; nothing lies in anything else."""
    if is_url(path) or not Path(path).is_dir():
        return False, []
    files = list(Path(path).iterdir())
    return any(map(is_cloud_file, files)), sorted(filter(is_bag, files))


def with_clouds(inputs: Sequence[str], folder: Path) -> tuple[str, ...]:
    """Return inputs with the clouds that `place_bags` makes in a folder instead of the bags."""
    paths = {bag: str(_cloud(folder, number, bag)) for number, bag in enumerate(bags_among(inputs))}
    with_bags = ([paths[bag.resolve()] for bag in bags_of(one)] or [one] for one in inputs)
    return tuple(dict.fromkeys(path for named in with_bags for path in named))


def place_bags(
    inputs: Sequence[str], folder: Path, choice: BagConfig, config: ScanConfig, tell: Callable[[str], None]
) -> list[dict[str, Any]]:
    """
    Make a LAZ file of each bag among inputs, but for those that are there from an earlier time.

    Each is made in a folder of its own, as bags of different places may have one name. `tell` is called with
    one line for each bag that was placed. Returned is what was read, placed and left out of each bag.
    InputError or OutputError if a bag cannot be read or placed, a file not be written, or all of the bags
    have no scan in the part that is chosen.
    """
    bags = bags_among(inputs)
    others = [one for one in inputs if not bags_of(one)]
    records = [
        _placed(bag, _cloud(folder, number, bag), others, choice, config, tell)
        for number, bag in enumerate(bags)
    ]
    if choice.start or choice.duration:
        empty = [bag for bag, one in zip(bags, records, strict=True) if not one["n_scans"]]
        if empty and len(empty) == len(bags):
            raise InputError(f"{', '.join(map(str, empty))}: {NO_SCAN}")
        for bag in empty:
            tell(f"{bag}: warning: {NO_SCAN}")
    return records


def _cloud(folder: Path, number: int, bag: Path) -> Path:
    return folder / str(number) / f"{bag.name if bag.is_dir() else bag.stem}.laz"


def _placed(
    bag: Path,
    path: Path,
    others: Sequence[str],
    choice: BagConfig,
    config: ScanConfig,
    tell: Callable[[str], None],
) -> dict[str, Any]:
    """Place a bag's scans, beside other inputs if there are any, unless that is done; return its record."""
    # what reads bags takes time to import
    from lidar_buildings.io.bags.beside_clouds import Beside, lay_beside
    from lidar_buildings.io.bags.placed_cloud import write_placed
    from lidar_buildings.io.clouds.las import open_inputs

    clouds = open_inputs(others)[0] if others else []
    if not clouds and (choice.offset or choice.align):
        raise ParameterError(f"{bag}: --offset and --align place a bag beside files, and no INPUT is one")
    note = path.parent / "record.json"
    wanted = {one.name: getattr(choice, one.name) for one in fields(BagConfig)}
    files = [bag, *bag.iterdir()] if bag.is_dir() else [bag]
    changed = max(file.stat().st_mtime_ns for file in files)
    wanted |= {"bag": str(bag), "changed": changed, **asdict(config)}
    if clouds:
        wanted["files"] = [[str(one.path), one.point_count] for one in clouds]
    if path.exists() and note.exists():
        record: dict[str, Any] = json.loads(note.read_text())
        if {name: record.get(name) for name in wanted} == wanted:
            return record
    path.parent.mkdir(parents=True, exist_ok=True)
    count = write_placed(bag, path, choice, config)
    beside = lay_beside(bag, path, clouds, choice) if clouds else Beside("")
    record = wanted | count._asdict()
    record["warnings"] = [*record["warnings"], *filter(None, [beside.warning])]
    record |= {"beside": beside.said, "alignment": beside.alignment} if clouds else {}
    note.write_text(json.dumps(record))
    tell(_line(bag, record))
    warnings = (f"warning: {one}" for one in record["warnings"])
    for said in filter(None, [count.place, beside.said, *warnings]):
        tell(f"{bag}: {said}")
    return record


def _line(bag: Path, record: dict[str, Any]) -> str:
    out = "".join(f"; {number:,} left out: {reason}" for reason, number in record["left_out"].items())
    said = "".join(f"; {number:,} {what}" for what, number in record["messages"].items())
    return f"{bag}: {record['n_points']:,} points of {record['n_scans']:,} scans placed{out}{said}"
