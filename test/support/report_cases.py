"""
Cases of the gallery `test/reports`: a folder each, with a README.md and a `case.py`.

README.md has the lines `Source:`, `Before:` and `Now:`. `case.py` has ``case(folder, house) -> Case``: it
writes its input into the empty `folder`, from code or from the simulated survey of one house (`house`, a
folder with strip_01.laz), and says what the command line is to answer; further imports, fixtures and files
are its own. ``python test/support/report_cases.py`` prints the table.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import laspy
import numpy as np
import pyogrio
import shapely

GALLERY = Path(__file__).resolve().parents[1] / "reports"
#: The simulated house's reference system, as GeoJSON has it.
CRS = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
#: Lines of a README.
LINES = ("Source", "Before", "Now")


@dataclass(frozen=True)
class Case:
    """What is called, and what is expected."""

    arguments: Sequence[object] = ()  #: of the command line; empty where `check` does all
    status: int = 0
    says: Sequence[str] = ()  #: each is part of a line
    silent: Sequence[str] = ()  #: none is part of a line
    n_lines: int | None = None  #: lines of standard error, if their number matters
    check: Callable[[], None] | None = None  #: asserts what the results are


def run_of(folder: Path, *inputs: object) -> list[object]:
    """Return the arguments of a run into ``folder/out``; options may follow the inputs."""
    return ["run", *inputs, "--no-ros", "--output", folder / "out"]


def rewritten(source: Path, target: Path, change: Callable[[laspy.LasData], laspy.LasData | None]) -> Path:
    """Write a cloud, changed."""
    cloud = laspy.read(source)
    (change(cloud) or cloud).write(target)
    return target


def areas_of(output: Path) -> list[float]:
    """Return the areas of a result's buildings."""
    return pyogrio.raw.read(output / "buildings.gpkg", layer="outlines", columns=["area"])[3][0].tolist()


def true_area(house: Path) -> float:
    """Return the area of the simulated house [m²]."""
    shapes = pyogrio.raw.read(house / "truth.gpkg", layer="outlines")[2]
    return float(shapely.area(shapely.from_wkb(shapes)).sum())


def true_middle(house: Path) -> np.ndarray:
    """Return x and y of the middle of the simulated house."""
    shapes = pyogrio.raw.read(house / "truth.gpkg", layer="outlines")[2]
    return shapely.get_coordinates(shapely.centroid(shapely.from_wkb(shapes)))[0]


def case_folders() -> list[Path]:
    """Return the folders of the gallery."""
    return sorted(path.parent for path in GALLERY.glob("*/README.md"))


def module_of(folder: Path) -> ModuleType:
    """Import the `case.py` of a folder."""
    spec = importlib.util.spec_from_file_location(f"report_{folder.name}", folder / "case.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def told(folder: Path) -> dict[str, str]:
    """Return the lines of a README: name → text."""
    lines = (line.partition(": ") for line in (folder / "README.md").read_text(encoding="utf-8").splitlines())
    return {name: text.strip() for name, _, text in lines if text.strip()}


def table() -> str:
    """Return the gallery's table."""
    rows = [f"| `{one.name}` | {' | '.join(told(one)[name] for name in LINES)} |" for one in case_folders()]
    return "\n".join(["| case | source | before | now |", "|---|---|---|---|", *rows])


if __name__ == "__main__":
    print(table())
