"""Whole runs of real clouds by a paper's preset and by the defaults: buildings, reasons, seconds."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from bench.papers.pages import Section, markdown
from lidar_buildings.io.vectors.layers import VectorLayer, read_layer

#: Clouds, and how long one run may take [s].
CLOUDS, LIMIT = ("delft", "fusa", "toronto", "montpellier"), 1800
#: What the regularisation says of walls that it could not draw straight.
THROUGH_POINTS = "drawn through traced points"
#: Largest buildings that are looked at one by one.
N_LARGEST = 10
HEADINGS = ("cloud", "method", "seconds", "buildings", "ok", "traced", "no model", "without a reason")
LARGEST = (
    "of the ten largest through traced points",
    "of them with a reason",
    "their vertices: median, most",
)


def sections_of_runs(data: Path, paper: str) -> Iterator[Section]:
    """Run every cloud that is there by a preset and by the defaults."""
    rows, maps = [], []
    for cloud in (name for name in CLOUDS if any((data / name).glob("*.laz"))):
        for preset in (paper, ""):
            found = _figures(data, cloud, preset)
            method = preset or "default"
            rows.append([cloud, method, *found.cells])
            if found.on_map:
                maps.append([method, *found.on_map])
    text = markdown((*HEADINGS, *LARGEST), rows)
    if maps:
        text += (
            f"\n\nDelft against the blocks of its map, cells of 0.5 m:\n\n{markdown(('method', *MAP), maps)}"
        )
    yield Section("runs", text)


class Found(NamedTuple):
    """What came of a run, as cells of tables."""

    cells: list[str]
    on_map: list[str]  #: empty of a cloud without a map


@cache
def _figures(data: Path, cloud: str, preset: str) -> Found:
    """Run a cloud by a preset, or by the defaults."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "result"
        if not _run("run", data / cloud, "--output", output, *(["--preset", preset] if preset else [])):
            return Found(["did not end", *["–"] * (len(HEADINGS) + len(LARGEST) - 3)], [])
        return Found(_row(output), _map_row(data, output) if cloud == "delft" else [])


def _run(*arguments: Any) -> bool:
    command = [sys.executable, "-m", "lidar_buildings.cli", *map(str, arguments), "--overwrite", "--quiet"]
    return subprocess.run(command, timeout=LIMIT, check=False).returncode == 0


def _row(output: Path) -> list[str]:
    """Return the seconds of a run, its buildings by status, and what is said of the ten largest."""
    seconds = json.loads((output / "run.json").read_text())["seconds"]["wall"]
    layer = read_layer(output / "buildings.gpkg", "outlines")
    status, reason = (layer.columns[name] for name in ("status", "reason"))
    silent = sum(s != "ok" and not str(r or "") for s, r in zip(status, reason, strict=True))
    counts = [str(sum(s == kind for s in status)) for kind in ("ok", "traced_outline")]
    others = str(sum(s not in ("ok", "traced_outline") for s in status))
    return [f"{seconds:.0f}", str(len(status)), *counts, others, str(silent), *_largest(layer)]


def _largest(layer: VectorLayer) -> list[str]:
    order = np.argsort(-shapely.area(layer.geometries))[:N_LARGEST]
    rough = [
        row for row in order if layer.columns["status"][row] != "ok" or THROUGH_POINTS in _text(layer, row)
    ]
    told = sum(bool(_text(layer, row)) for row in rough)
    sizes = [int(shapely.get_num_coordinates(layer.geometries[row])) - 1 for row in order]
    return [f"{len(rough)} of {len(order)}", str(told), f"{np.median(sizes):.0f}, {max(sizes)}"]


def _text(layer: VectorLayer, row: int) -> str:
    return str(layer.columns["reason"][row] or "")


#: Headings of the map's table.
MAP = ("recall", "precision", "IoU")


def _map_row(data: Path, output: Path) -> list[str]:
    command = [sys.executable, "-m", "lidar_buildings.cli", "score", "buildings", output]
    command += [data / "delft" / "blocks_nw.gpkg", "--aoi", data / "delft" / "aoi_nw.gpkg", "--json"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True)
    figures = json.loads(done.stdout)
    return [f"{figures[name]:.2f}" for name in ("recall", "precision", "iou")]
