"""
The ground filters that are compared: this package's methods and their peers.

A peer is taken in if `pip` installs it from a wheel on Linux with Python 3.11, its licence is permissive and
it works without a network and without a licence key. Looked at, with what came of it:

======================  ============  =======================================================================
package                 licence       verdict
======================  ============  =======================================================================
cloth-simulation-filter Apache-2.0    taken: CSF (Zhang et al. 2016), as ``csf``
whitebox-workflows      MIT, Apache   taken: its ``improved_ground_point_filter``, as ``whitebox``; it works
                                      from file to file, so that reading and writing LAS is in its time
pdal                    BSD           left out: source only, it needs the PDAL library installed beforehand
smrf                    –             left out: no release that pip finds; it is installed from its repository
pyforestscan            MIT           left out: calls PDAL's SMRF, and needs `pdal`
whitebox, pywbt         MIT           left out: they download a program when first used
laserchicken            Apache-2.0    left out: features of points and normalisation, no ground filter
lasR, lidR              GPL-3         left out: R packages
======================  ============  =======================================================================
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray

from bench.common.clouds import Cloud
from lidar_buildings.core.model.parameters import spec_of
from lidar_buildings.core.stages.ground_filter import GroundFilterConfig, classify_ground
from lidar_buildings.evaluation.scores.ground import RESULT_GROUND

# Threads of CSF that wait in a loop for one another take minutes where the machine has other work.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

#: Side of CSF's cloth cells [m]: what its release 1.1.7 has by default.
CLOTH_RESOLUTION = 1.0


class GroundFilter(NamedTuple):
    """
    A filter in the three steps of which the second is timed.

    Attributes
    ----------
    prepare : callable
        Cloud → what `run` takes.
    run : callable
        The filter itself.
    mask : callable
        What `run` returned and the number of points → True where ground.
    package : str
        What has to be importable.
    """

    prepare: Callable[[Cloud], Any]
    run: Callable[[Any], Any]
    mask: Callable[[Any, int], NDArray[np.bool_]]
    package: str

    @property
    def installed(self) -> bool:
        """Whether the package is there."""
        return importlib.util.find_spec(self.package) is not None


def own_methods() -> tuple[str, ...]:
    """Return the package's methods, the default first; not the one for clouds without ground."""
    method = next(field for field in fields(GroundFilterConfig) if field.name == "method")
    return tuple(name for name in spec_of(method).choices if name != "none")


def own_filter(method: str, settings: Mapping[str, Any] | None = None) -> GroundFilter:
    """Return one of the package's methods, with its defaults but for `settings`."""
    config = GroundFilterConfig(**{**(settings or {}), "method": method})
    return GroundFilter(
        prepare=lambda cloud: cloud,
        run=lambda cloud: classify_ground(cloud.points, config, **cloud.scan).classification,
        mask=lambda classification, n_points: np.isin(classification, RESULT_GROUND),
        package="lidar_buildings",
    )


def _run_csf(points: NDArray[np.float64]) -> Any:
    """Cloth simulation with the library's own defaults."""
    import CSF

    cloth = CSF.CSF()
    cloth.params.cloth_resolution = CLOTH_RESOLUTION
    cloth.setPointCloud(points)
    ground, others = CSF.VecInt(), CSF.VecInt()
    cloth.do_filtering(ground, others, False)
    return ground


def _csf_mask(ground: Any, n_points: int) -> NDArray[np.bool_]:
    """Row numbers → mask."""
    mask = np.zeros(n_points, dtype=bool)
    mask[np.fromiter(ground, dtype=np.int64, count=len(ground))] = True
    return mask


def _whitebox_job(cloud: Cloud, folder: Path) -> Any:
    """Write the points to a file and open it with the library."""
    import whitebox_workflows

    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.full(3, 0.001), np.floor(cloud.points.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.points.T
    las.return_number[:] = las.number_of_returns[:] = 1
    las.write(folder / "points.las")
    del las
    environment = whitebox_workflows.WbEnvironment()
    return environment, environment.read_lidar(str(folder / "points.las")), str(folder / "ground.las")


def _run_whitebox(job: Any) -> str:
    """Filter with the library's own defaults, from file to file."""
    environment, lidar, output = job
    tools = environment.lidar.filtering_classification
    tools.improved_ground_point_filter(input=lidar, classify=True, output=output)
    return output


def _whitebox_mask(output: str, n_points: int) -> NDArray[np.bool_]:
    """Classes of the written file → mask."""
    classification = np.asarray(laspy.read(output).classification)
    if len(classification) != n_points:
        raise RuntimeError(f"{output}: holds {len(classification)} of {n_points} points")
    return classification == 2


CSF_FILTER = GroundFilter(lambda cloud: cloud.points, _run_csf, _csf_mask, "CSF")


@contextlib.contextmanager
def peers() -> Iterator[dict[str, GroundFilter]]:
    """Give the other libraries' filters, installed or not, and a folder for those that need files."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        whitebox = partial(_whitebox_job, folder=Path(folder))
        yield {
            "csf": CSF_FILTER,
            "whitebox": GroundFilter(whitebox, _run_whitebox, _whitebox_mask, "whitebox_workflows"),
        }


#: Names of the peers.
PEERS = ("csf", "whitebox")


@contextlib.contextmanager
def filters(
    names: Collection[str], settings: Mapping[str, Any] | None = None
) -> Iterator[dict[str, GroundFilter]]:
    """Give filters by name, in the order given."""
    with peers() as others:
        own = own_methods()
        yield {name: own_filter(name, settings) if name in own else others[name] for name in names}


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what compiled libraries print off the standard output."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def ground_mask(ground_filter: GroundFilter, cloud: Cloud) -> NDArray[np.bool_]:
    """Run all three steps."""
    with quiet():
        return ground_filter.mask(ground_filter.run(ground_filter.prepare(cloud)), len(cloud.points))


def filter_names() -> tuple[str, ...]:
    """Return the names of all filters, installed or not."""
    return (*own_methods(), *PEERS)


def installed(names: Sequence[str]) -> list[str]:
    """Leave out the peers that are not installed, and say so."""
    with peers() as others:
        missing = [name for name in names if name in others and not others[name].installed]
    for name in missing:
        print(f"{name}: not installed (pip install '.[bench]')", file=sys.stderr)
    return [name for name in names if name not in missing]
