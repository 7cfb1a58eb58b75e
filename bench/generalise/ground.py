"""The ground filter on disturbed clouds: total error against the reference's ground."""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

from bench.common.arguments import settings_of
from bench.common.clouds import Cloud, read_cloud
from bench.common.tables import table
from bench.generalise.disturbances import disturbances
from bench.generalise.figures import FIGURE_HEADINGS, Score, rows_of
from bench.ground.isprs import read_samples
from bench.ground.methods import METHODS
from bench.ground.scores import score_of

#: Least share of ground in a disturbed cloud that is judged: without any the lowest surface is ground.
MIN_GROUND = 0.1
#: Providers' clouds → classes that count as ground there.
PROVIDERS = {
    "delft": (2, 9),
    "montpellier": (2,),
    "fusa": (2,),
    "amsterdam": (2,),
    "stbarth": (2,),
    "sparse": (2, 9),
    "lowdensity": (2,),
}


def read_clouds(data: Path, names: list[str]) -> dict[str, Cloud]:
    """Read the sets asked for, by cloud: the `isprs` samples, and each file of the `providers`."""
    clouds = read_samples(data / "isprs") if "isprs" in names else {}
    for folder, classes in PROVIDERS.items() if "providers" in names else ():
        for path in sorted((data / folder).glob("*.laz")):
            clouds[f"{folder}/{path.stem}"] = read_cloud([path], classes)
    return clouds


def versions(clouds: Mapping[str, Cloud], quick: bool, seed: int) -> Iterator[tuple[str, str, Cloud]]:
    """Yield every cloud plain and disturbed, with its name and kind."""
    for name, cloud in clouds.items():
        yield name, "plain", cloud
        for one in disturbances(cloud.points, cloud.scan, quick=quick, seed=zlib.crc32(name.encode()) + seed):
            is_ground = cloud.is_ground[one.rows]
            if is_ground.mean() >= MIN_GROUND:
                yield f"{name} {one.name}", one.kind, Cloud(one.points, one.columns, is_ground)


def report(data: Path, options: argparse.Namespace) -> str:
    """Return the table of this part."""
    clouds, settings = read_clouds(data, options.clouds), settings_of(options.set)
    rows: list[list[str]] = []
    for method in options.methods or METHODS[:1]:
        scores = [
            Score(case, kind, score_of(cloud, method, settings).total_error)
            for case, kind, cloud in versions(clouds, options.quick, options.seed)
        ]
        rows += rows_of(method, scores)
    return table(("method", "total error", *FIGURE_HEADINGS), rows)
