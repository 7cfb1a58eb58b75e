"""What a run has made, and what else ``run.json`` holds."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from lidar_buildings import __version__
from lidar_buildings.core.model.classes import CLASS_GROUPS, ON_TERRAIN, PointClass
from lidar_buildings.core.model.grade import Grade, causes_in
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.io.results.output_config import FORMAT_FILES

_LIBRARIES = (
    "numpy", "scipy", "numba", "scikit-learn", "shapely", "laspy", "lazrs", "pyogrio", "pyproj", "rasterio",
)  # fmt: skip


#: Status of a building in a run without models.
_NO_FEATURE = "unknown"


@dataclass(frozen=True)
class BuildingCounts:
    """How many buildings there are of each kind."""

    statuses: Counter[str] = field(default_factory=Counter)
    grades: Counter[str] = field(default_factory=Counter)  #: none in a run without models
    causes: Counter[str] = field(default_factory=Counter)  #: code of a doubt → buildings that have it

    @property
    def total(self) -> int:
        """All buildings."""
        return self.statuses.total()

    def count(self, attributes: Mapping[str, Any]) -> None:
        """Add a building."""
        self.statuses[attributes.get("status") or _NO_FEATURE] += 1
        if grade := attributes.get("quality"):
            self.grades[grade] += 1
            self.causes.update(set(causes_in(attributes.get("quality_reasons") or "")))

    def add(self, others: BuildingCounts) -> None:
        """Add other buildings."""
        for name in ("statuses", "grades", "causes"):
            getattr(self, name).update(getattr(others, name))


@dataclass(frozen=True)
class RunSummary:
    """What a run has made, as ``run.json`` tells it."""

    files: tuple[str, ...]  #: relative to the output folder
    #: Finished tiles; points of all inputs.
    n_tiles: int
    n_points: int
    n_unclassified: int  #: points in none of the finished tiles; they keep their class
    classes: dict[int, int]  #: class number → points
    buildings: dict[str, int]  #: status → buildings
    n_seam_pieces: int  #: buildings left out because a neighbouring tile has them as part of a larger one
    #: File name → its columns, rows, side of a cell in the source's unit, and known cells.
    rasters: dict[str, dict[str, Any]]
    problems: tuple[str, ...]  #: one line per input that could not be read to its end
    #: What became of the footprints that were given: how many were read, used, repaired, left out for which
    #: reason, and outside the data. Empty where outlines were traced.
    footprints: dict[str, Any] = field(default_factory=dict)
    #: What a person should know: what can hardly be so in the inputs or the result, formats that this survey
    #: cannot have, buildings that lack the finest level of detail.
    remarks: tuple[Remark, ...] = ()
    n_facade: int = 0  #: points of class 6 that are façade
    #: Points that were seen from the street, and those of them at places that were seen from above, too.
    n_street: int = 0
    n_covered: int = 0
    facade_count: int = 0  #: in the layer `facades`
    facade_length: float = 0.0  #: length of them that was seen [m]
    quality: dict[str, int] = field(default_factory=dict)  #: grade → buildings, empty without models
    quality_reasons: dict[str, int] = field(default_factory=dict)  #: code → buildings of which it is told

    @property
    def set_aside(self) -> dict[str, int]:
        """Points of classes that never become roof and that a run does not give itself, by group."""
        groups = {
            name: sum(self.classes.get(number, 0) for number in CLASS_GROUPS[name])
            for name in CLASS_GROUPS.keys() - {"noise", "road"}
        }
        return {name: n for name, n in sorted(groups.items()) if n}

    @property
    def n_doubtful(self) -> int:
        """Buildings that are not good."""
        return sum(self.quality.values()) - self.quality.get(Grade.GOOD.value, 0)

    @property
    def view_words(self) -> str:
        """From where points were seen, empty if from above alone."""
        if not self.n_street:
            return ""
        words = f"seen from the street: {self.n_street:,} of {counted(self.n_points, 'point')}"
        if not self.n_covered:
            return words
        return f"{words}; {self.n_covered:,} of them at places seen from above, where these tell the roofs"

    @property
    def building_words(self) -> list[str]:
        """What is told of the buildings at the end: how many are how good, why not, and what failed."""
        n, failed = sum(self.buildings.values()), dict(self.buildings)
        if not self.quality:
            return [f"buildings: {n:,}", *self._facade_words]
        failed.pop(BuildingStatus.OK.value, None)
        known = {one.value: self.quality.get(one.value, 0) for one in Grade}
        grades = ", ".join(f"{number:,} {grade}" for grade, number in known.items() if number)
        lines = [f"buildings: {n:,} ({grades})"]
        for name, counts in (("quality_reasons", self.quality_reasons), ("status", failed)):
            if counts:
                most = sorted(counts.items(), key=lambda one: (-one[1], one[0]))
                lines.append(f"{name}: {', '.join(f'{number:,} {what}' for what, number in most)}")
        return [*lines, *self._facade_words]

    @property
    def _facade_words(self) -> list[str]:
        if not self.facade_count:
            return []
        return [f"facades: {self.facade_count:,} ({self.facade_length:,.0f} m of walls seen from the street)"]

    @property
    def why_no_building(self) -> str:
        """What to do about a run that was to find buildings and found none, empty if it did."""
        if self.buildings or not self.n_points or FORMAT_FILES["gpkg"][0] not in self.files:
            return ""
        if self.facade_count:
            return (
                "no building was found: roofs show from above, and from the street walls alone were seen, as "
                "layers facades and street_lines hold them"
            )
        roof = self.classes.get(PointClass.BUILDING, 0) - self.n_facade
        aside = ", ".join(f"{n:,} {name}" for name, n in self.set_aside.items())
        kept = f"; set aside by their class: {aside} (ground_filter.kept_classes)" if aside else ""
        return (
            f"no building was found: of {self.n_points:,} points {roof:,} are roof, too few for one, and "
            f"{self.n_facade:,} are walls: roofs show from above, a vehicle sees walls only; points of roofs "
            "alone need ground_filter.method=none (doc/data_requirements.md); `lidar-buildings explain DIR "
            f"X,Y` says why at a place{kept}"
        )


#: Shares of the points beyond which a look is needed: of Delft, Montpellier, Toronto, sparse and simulated
#: surveys buildings have 0.04 to 0.55, ground 0.24 to 0.9, and 0.03 at most stay unexplained.
_MOST_BUILDING, _LEAST_GROUND, _MOST_UNEXPLAINED = 0.75, 0.05, 0.25
#: Share of the points that no single building of a survey has, and points that are a survey.
_MOST_OF_ONE, _SURVEY = 0.5, 1000
_ON_GROUND = (PointClass.GROUND, *(one for group in ON_TERRAIN for one in CLASS_GROUPS[group]))


def unlikely_shares(classes: Mapping[int, int]) -> list[Remark]:
    """Return a remark for each kind of points of which a survey has hardly so many, or so few."""
    noise = CLASS_GROUPS["noise"]
    total = sum(n for number, n in classes.items() if number not in noise)
    if total < _SURVEY:
        return []
    building, ground, other = (
        sum(classes.get(number, 0) for number in numbers) / total
        for numbers in ((PointClass.BUILDING,), _ON_GROUND, (PointClass.UNCLASSIFIED,))
    )
    found = []
    if building > _MOST_BUILDING:
        found.append(("much_building", f"{building:.0%} of the points are building: is some of it ground?"))
    if ground < _LEAST_GROUND:
        why = "is it missing in the survey, or too steep for ground_filter?"
        found.append(("little_ground", f"{ground:.1%} of the points are ground: {why}"))
    if other > _MOST_UNEXPLAINED:
        why = "neither ground nor building nor vegetation"
        found.append(("much_unexplained", f"{other:.0%} of the points are unexplained: {why}"))
    return [Remark(code, text) for code, text in found]


def unlikely_building(name: str, n_points: int, total: int) -> list[Remark]:
    """Return a remark if a survey's largest building has most of its points."""
    if total < _SURVEY or n_points <= _MOST_OF_ONE * total:
        return []
    text = f"building {name} has {n_points / total:.0%} of all points: was ground taken for its roof?"
    return [Remark("one_building", text)]


def run_record(own: Mapping[str, Any], summary: RunSummary, info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of ``run.json``: what the folder knows, has made, and is told besides."""
    record = {**own, **asdict(summary), "set_aside": summary.set_aside}
    return record | {name: value for name, value in info.items() if name not in record}


def run_info(
    seconds: Mapping[str, float],
    parameters: Mapping[str, Any],
    failed: Mapping[int, str],
    problems: Iterable[str],
) -> dict[str, Any]:
    """Return versions, parameters, seconds by stage, failed tiles and problems of a run."""
    libraries = {name: _version(name) for name in _LIBRARIES}
    return {
        "versions": {"lidar_buildings": __version__, "python": sys.version.split()[0], **libraries},
        "parameters": dict(parameters),
        "seconds": {stage: round(taken, 3) for stage, taken in seconds.items()},
        "failed_tiles": [{"tile": stamp, "reason": failed[stamp]} for stamp in sorted(failed)],
        "problems": list(problems),
    }


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "unknown"


def counted(number: int, what: str) -> str:
    """Write how many there are of something."""
    return f"{number:,} {what}" if number == 1 else f"{number:,} {what}s"
