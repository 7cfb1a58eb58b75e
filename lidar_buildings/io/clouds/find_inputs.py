"""From what a user names (files, folders, globs) to the list of clouds."""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.parameters import StageConfig, fixed
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.io.files.failures import reported
from lidar_buildings.io.files.locations import located, state_of


@dataclass(frozen=True)
class InputConfig(StageConfig):
    """What inputs may leave unsaid."""

    crs: str = fixed(
        "",
        "Reference system of inputs that name none, such as EPSG:28992, the same for `tile_player` and "
        "`model_writer`; inputs that name another one are refused.",
        advanced=True,
    )


class InputFile(NamedTuple):
    """One input of a run."""

    path: Path
    point_count: int
    #: Its size [bytes] and when it was last changed [ns], where it is to stay as it is.
    state: tuple[int, int] | None = None
    kept: Path | None = None  #: where its points are decoded, once they have been read
    remarks: tuple[Remark, ...] = ()  #: what its header or first points say that can hardly be so
    #: Least x and y, greatest x and y [m], None where it is not known, or the file holds no point.
    area: tuple[float, float, float, float] | None = None

    @property
    def is_away(self) -> bool:
        """Whether it is not there, or cannot be opened, as a file that was deleted."""
        try:
            state_of(self.path)
        except OSError:
            return True
        return False


def check_unchanged(file: InputFile) -> None:
    """Refuse a file that was replaced, or written to, since its state was noted; InputError if it was."""
    with reported(file.path):
        if file.state is not None and state_of(file.path) != file.state:
            raise changed(file.path)


def changed(path: Path) -> InputError:
    """Return what is said of a file that is not the one it was."""
    return InputError(f"{path}: changed during the run: run it again with --overwrite")


#: Endings of cloud files, in any case; ``.copc.laz`` is one of them.
ENDINGS = (".las", ".laz")

#: What other files of points are called → what they are.
_OTHERS = {
    ".e57": "E57",
    ".ply": "PLY",
    ".pcd": "PCD",
    ".xyz": "points as text",
    ".pts": "points as text",
    ".asc": "points as text",
    "ept.json": "Entwine (EPT)",
    ".drc": "Draco",
    ".pcap": "a scanner's packets",
    ".zlas": "Esri's zLAS",
}
#: How LAZ is made of such, where it is not by PDAL.
_BY_OTHERS = {
    ".pts": "CloudCompare",
    ".asc": "CloudCompare",
    ".drc": "draco_decoder, and `pdal translate` of the PLY file that it makes,",
    ".pcap": "the scanner's own software",
    ".zlas": "Esri's EzLAS",
}

_Opened = TypeVar("_Opened")
#: What a user names: files, folders, globs.
Inputs = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]


def find_inputs(inputs: Inputs) -> list[Path]:
    """Expand inputs as `search_inputs`; InputError if any of them names nothing."""
    files, problems = search_inputs(inputs)
    if problems:
        raise InputError(*problems)
    return files


def search_inputs(inputs: Inputs) -> tuple[list[Path], list[str]]:
    """
    Expand files, folders and globs to the files they name, each once, in the order given.

    Of folders the LAS and LAZ files directly in them, by name. Beside them one line for each input that names
    nothing; InputError if nothing was found.
    """
    named = [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
    if not named:
        raise InputError("no input: give at least one LAS or LAZ file, or a folder of them")
    found: dict[Path, Path] = {}
    problems = []
    for path in named:
        try:
            place = located(path)
            with reported(place):
                files = sorted(one for one in named_by(place) if one == place or is_cloud_file(one))
            if not files and place.is_dir():
                raise InputError(
                    (isinstance(place, Path) and others_within(place))
                    or f"{place}: contains no .las or .laz file itself: give another folder, or files"
                )
            if not files:
                raise InputError(f"{place}: matches no .las or .laz file: check the pattern")
            for file in files:
                if not _is_text(str(file)):
                    raise InputError(f"{file}: its name is no text in UTF-8, which files need: rename it")
                found.setdefault(file.resolve() if isinstance(file, Path) else file, file)
        except InputError as error:
            problems.append(str(error))
    if not found:
        raise InputError(*problems)
    return list(found.values()), problems


def _is_text(name: str) -> bool:
    """Whether a name can be written into files; bytes of another encoding cannot."""
    return not any("\ud800" <= one <= "\udfff" for one in name)


def named_by(path: Path) -> list[Path]:
    """Return a path itself, what is directly in a folder, or matches a pattern; InputError if it is none."""
    if not isinstance(path, Path) and path.name.lower().endswith(ENDINGS) and not glob.has_magic(str(path)):
        return [path]  # asked for by opening it: servers of the web answer such questions with whole files
    if path.is_dir():
        return list(path.iterdir())
    if not path.exists() and not glob.has_magic(str(path)):
        raise InputError(f"{path}: no such file or folder: check the path")
    if path.exists():
        return [path]
    if isinstance(path, Path):
        return [Path(one) for one in glob.glob(str(path), recursive=True)]
    there = cast(Any, path)
    return [there.with_segments(there.fs.unstrip_protocol(one)) for one in there.fs.glob(there.path)]


def is_cloud_file(path: Path) -> bool:
    """Whether a path is a file that is called as clouds are."""
    return path.name.lower().endswith(ENDINGS) and path.is_file()


def what_else(path: Path) -> str:
    """Say what a file of points is that is not LAS or LAZ, and how LAZ is made of it; empty if not known."""
    ending = next((one for one in _OTHERS if path.name.lower().endswith(one)), "")
    if not ending:
        return ""
    own = f"`pdal translate {path.name} {path.stem}.laz`"
    if ending in (".ply", ".pcd"):
        own = f"pip install '.[formats]' in the sources reads it, or {own}"
    return f"is {_OTHERS[ending]}, which is not read: {_BY_OTHERS.get(ending, own)} makes LAZ of it"


def others_within(path: Path) -> str:
    """Say what else than LAS or LAZ is in a folder; empty if nothing that is known."""
    within = sorted(path.iterdir()) if path.is_dir() else []
    return next((f"{one}: {what}" for one in within if (what := what_else(one))), "")


def open_each(inputs: Inputs, open_one: Callable[[Path], _Opened]) -> tuple[list[_Opened], list[str]]:
    """Open what can be opened of inputs; beside it a line for each other. InputError if there is none."""
    opened: list[_Opened] = []
    paths, problems = search_inputs(inputs)
    for path in paths:
        try:
            opened.append(open_one(path))
        except InputError as error:
            problems.append(str(error))
    if not opened:
        raise InputError(*problems)
    return opened, problems
