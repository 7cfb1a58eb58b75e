"""The command line called in this process, and what tests look at afterwards."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from support import cloud_files
from support.results import MODELS

from lidar_buildings.cli import main

TILES3D = "tiles3d"
#: What a run of the one house writes.
RASTERS = ["dsm.tif", "dtm.tif", "ndsm.tif"]
CLASSIFIED = "classified/strip_01.laz"
FILES = ["buildings.gpkg", *MODELS, CLASSIFIED, *RASTERS, "report.html", "run.json", TILES3D]
#: Cuts the house's survey into nine tiles.
SMALL_TILES = ["--tile-size", "25", "--set", "tile_player.buffer=10"]
PROGRESS = re.compile(r"(?P<tiles>\d+ of \d+ tiles? done)(, .*)?")


class Spoken(NamedTuple):
    """How a command ended and what it said, progress apart."""

    status: int
    out: list[str]
    err: list[str]
    progress: list[str]


class Command:
    """Calls the command line and keeps what it prints, compiled libraries' printing included."""

    def __init__(self, capfd: pytest.CaptureFixture[str], *always: str) -> None:
        self._capfd, self._always = capfd, always

    def __call__(self, *arguments: object) -> Spoken:
        self._capfd.readouterr()
        try:
            status = main([*map(str, arguments), *self._always])
        except SystemExit as stopped:
            status = stopped.code
        captured = self._capfd.readouterr()
        lines = captured.err.splitlines()
        progress = [line for line in lines if PROGRESS.fullmatch(line)]
        return Spoken(status, captured.out.splitlines(), [x for x in lines if x not in progress], progress)

    def refused(self, *arguments: object) -> str:
        """Return the one line that a refused command says."""
        spoken = self(*arguments)
        assert spoken.status == 2
        assert spoken.out == []
        assert len(spoken.err) == 1, spoken.err
        assert spoken.err[0].startswith("lidar-buildings")
        assert spoken.err[0].count(": ") >= 2, "where: what is wrong: what to do"
        return spoken.err[0]


def files_in(folder: Path) -> list[str]:
    """Every file in a folder and those below it, hidden ones too; of 3D Tiles the folder."""
    found = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    return sorted({TILES3D if name.startswith(f"{TILES3D}/") else name for name in found})


#: Way a cloud can be bad → its file, and words of the line about it.
BAD = {
    "missing file": ("nowhere.laz", "no such file"),
    "missing folder": ("nowhere", "no such file or folder"),
    "pattern without match": ("nowhere*.laz", "matches no .las or .laz file"),
    "empty file": ("empty.laz", "is empty (0 bytes)"),
    "file of another kind": ("text.laz", "is not a LAS or LAZ file"),
    "truncated LAZ": ("cut.laz", "is truncated"),
    "truncated LAS": ("cut.las", "is truncated"),
    "damage in the middle": ("late.laz", "cannot be decoded"),
}


def bad_clouds(folder: Path, good: Path) -> dict[str, tuple[Path, str]]:
    """Make the files of `BAD`: case → (file, words of the line about it)."""
    folder.mkdir()
    (folder / "empty.laz").write_bytes(b"")
    (folder / "text.laz").write_text("no cloud, but long enough to be taken for one\n" * 40)
    for name in ("cut.laz", "cut.las"):
        whole = cloud_files.saved(cloud_files.random_cloud(5000, point_format=6), folder / name)
        cloud_files.shortened(whole, 0.6)
    late = folder / "late.laz"
    late.write_bytes(good.read_bytes())
    size = late.stat().st_size
    cloud_files.patched(
        late, int(size * 0.6), bytes(np.random.default_rng(0).integers(0, 256, size // 5, "u1"))
    )
    return {case: (folder / name, words) for case, (name, words) in BAD.items()}


def lines_of(text, first):
    """The words of the lines of a table that begin with a word."""
    return [line.split() for line in text.splitlines() if line.split()[:1] == [first]]
