"""The file ``report.html``: one page with its data, style and scripts, which opens without a network."""

from __future__ import annotations

import base64
import html
import string
import zlib
from collections.abc import Iterable, Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import CLASS_NAMES
from lidar_buildings.core.model.grade import Grade
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.io.files.atomic_files import atomic_file, compact_json
from lidar_buildings.io.results.output_config import REPORT_FILE
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.report import summary_words as words
from lidar_buildings.report.contents import UNKNOWN, Contents, Relief, contents_of
from lidar_buildings.report.result_folder import ReportedBuilding, read_result

#: In this order: what a later one uses stands before it.
_SCRIPTS = ("data", "camera", "drawing", "scene", "ground", "residuals", "map", "lists", "viewer")
#: What a building that is well is called.
_WELL = (Grade.GOOD.value, BuildingStatus.OK.value)
_MILLIMETRES = 1000
#: Kind of ring → its number in the page.
_OUTLINE, _TRACED = 0, 1
#: Grade → its colour, as in the page's scripts.
_COLOURS = {Grade.GOOD.value: "#2f9e63", Grade.CHECK.value: "#e0a526", Grade.POOR.value: "#c2262e"}
#: Fast: finer levels take four times as long for a twentieth of the size.
_LEVEL = 1


def write_report(folder: Path, run: dict[str, Any] | None = None) -> Path:
    """
    Write the page of a result into its folder.

    `run` is what ``run.json`` is to hold, where it is not written yet. InputError if the folder holds no
    result that can be read, OutputError if the page cannot be written.
    """
    path = folder / REPORT_FILE
    write_page(path, contents_of(read_result(folder, run)))
    return path


def write_page(path: Path, contents: Contents, explanation: str = "") -> None:
    """Write a page, with the explanation of its building if there is one."""
    text = page_of(contents, explanation)
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def page_of(contents: Contents, explanation: str = "") -> str:
    """Return a page as text."""
    result = contents.result
    problems = words.problems(result.run)
    parts = {
        "title": html.escape(_title(contents)),
        "figures": _figures(words.figures(result)),
        "alarm": f'<a class="alarm" href="#run">{counted(len(problems), "problem")}</a>' if problems else "",
        "headlines": _rows(words.headlines(result).items()),
        "notes": _items([*words.notes(result), *words.remarks(result.run), *_limits(contents)]),
        "problems": _items(problems),
        "stages": _stage_rows(words.stage_seconds(result.run)),
        "parameters": _rows(words.changed_parameters(result.run))
        or "<tr><td>none: all parameters have their defaults</td></tr>",
        "files": _links(str(name) for name in result.run.get("files", ())),
        "explanation": html.escape(explanation),
        "data": "\n".join(_elements(contents)),
        "style": _packaged("style.css"),
        "script": "\n".join(_packaged(f"{name}.js") for name in _SCRIPTS),
    }
    return string.Template(_packaged("page.html")).substitute(parts)


def _elements(contents: Contents) -> Iterator[str]:
    models, points = contents.models, contents.points
    rings, vertices = _ring_arrays(contents.buildings)
    yield _element("facts", "json", "", compact_json(_facts(contents)).encode())
    for name in ("vertices", "triangles", "faces", "kinds", "solids"):
        yield array_element(name, getattr(models, name))
    for name, array in (
        ("points", points.steps),
        ("classes", points.classes),
        ("building", points.building),
        ("plane", points.plane),
        ("rings", rings),
        ("ring_vertices", vertices),
        ("dots", _dots(contents.others)),
    ):
        yield array_element(name, array)
    if points.colours is not None:
        yield array_element("colours", points.colours)
    for name, relief in (("terrain", contents.terrain), ("overview", contents.overview)):
        if relief is not None:
            yield array_element(name, relief.steps)


def _facts(contents: Contents) -> dict[str, Any]:
    points = contents.points
    names = [one.name for one in contents.buildings]
    return {
        "names": names,
        "attributes": [one.attributes for one in contents.buildings],
        "worst": [{"row": names.index(one.building.name), "why": one.why} for one in contents.worst],
        "focus": contents.focus,
        "is_served": contents.is_served,
        "histograms": words.histograms(contents.result),
        "points": {"corner": points.corner.tolist(), "step": points.step.tolist()},
        "terrain": _relief_facts(contents.terrain),
        "overview": _relief_facts(contents.overview),
        "origin": list(contents.result.frame.origin),
        "unit": contents.result.unit,
        "class_names": CLASS_NAMES,
    }


def _relief_facts(relief: Relief | None) -> dict[str, Any] | None:
    if relief is None:
        return None
    known = {name: getattr(relief, name) for name in ("middle", "step", "west", "north")}
    return {**known, "cell": list(relief.cell), "unknown": UNKNOWN}


def _ring_arrays(buildings: Sequence[ReportedBuilding]) -> tuple[Any, Any]:
    """Return (row, kind, first vertex, number of vertices) of all rings, and their vertices [mm]."""
    rings, vertices, n_vertices = [], [np.empty((0, 2))], 0
    for row, building in enumerate(buildings):
        for kind, polygon in ((_OUTLINE, building.outline), (_TRACED, building.traced)):
            if polygon is None or polygon.is_empty:
                continue
            for ring in (polygon.exterior, *polygon.interiors):
                places = shapely.get_coordinates(ring)[:-1]
                rings.append((row, kind, n_vertices, len(places)))
                vertices.append(places)
                n_vertices += len(places)
    whole = np.rint(np.concatenate(vertices) * _MILLIMETRES).astype(np.int32)
    return np.array(rings, dtype=np.int32).reshape(-1, 4), whole


def _dots(buildings: Sequence[ReportedBuilding]) -> Any:
    """Return x and y of buildings [dm], and 2 where they are well, 1 where they are to be checked."""
    shapes = np.array([one.shape for one in buildings], dtype=object)
    places = shapely.get_coordinates(shapely.centroid(shapes))
    if len(places) < len(buildings):
        return np.empty((0, 3), dtype=np.int32)
    standings = [one.quality or one.status for one in buildings]
    marks = np.array([2 * (one in _WELL) + (one == Grade.CHECK.value) for one in standings], dtype=np.float64)
    return np.rint(np.column_stack([places * 10, marks])).astype(np.int32)


def _limits(contents: Contents) -> Iterator[str]:
    """Say what is left out of the page to keep it small."""
    if contents.focus is None and contents.others:
        yield (
            f"The 3D view shows {counted(len(contents.buildings), 'building')}: near ones, and the worst; "
            f"the map has dots for {counted(len(contents.others), 'other')}. "
            + (
                "A click on one shows those near it."
                if contents.is_served
                else "lidar-buildings serve shows those, too."
            )
        )
    if contents.models.n_left_out:
        left_out = counted(contents.models.n_left_out, "building")
        yield f"Shown as outlines only, to keep the page small: {left_out}."
    shown, total = len(contents.points.steps), contents.result.run.get("n_points", 0)
    if contents.focus is None and shown < total:
        yield f"{shown:,} of {total:,} points are shown, more of buildings than of the rest; none of noise."


def _title(contents: Contents) -> str:
    if contents.focus is not None:
        return f"{contents.buildings[contents.focus].name} of {contents.result.folder.name}"
    return f"Buildings of {contents.result.folder.resolve().name}"


def _figures(figures: Iterable[words.Figure]) -> str:
    lines = []
    for one in figures:
        total = sum(one.shares.values())
        bars = "".join(
            f'<i style="width:{100 * n / total:.2f}%;background:{_COLOURS[name]}"></i>'
            for name, n in one.shares.items()
        )
        share = f'<span class="share">{bars}</span>' if bars else ""
        value, more = html.escape(one.value), html.escape(one.more)
        lines.append(f"<div><dt>{one.title}</dt><dd>{value}{share}<small>{more}</small></dd></div>")
    return "\n".join(lines)


def _links(names: Iterable[str]) -> str:
    """Return files that lie beside the page as links."""
    return "\n".join(f'<li><a href="{quote(name)}">{html.escape(name)}</a></li>' for name in names)


def _rows(rows: Iterable[Sequence[str]]) -> str:
    return "\n".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )


def _stage_rows(stages: Sequence[tuple[str, float]]) -> str:
    most = max((taken for _, taken in stages), default=1.0) or 1.0
    return "\n".join(
        f"<tr><td>{html.escape(name)}</td><td>{taken:,.2f} s</td>"
        f'<td class="wide"><div class="bar" style="width:{100 * taken / most:.1f}%"></div></td></tr>'
        for name, taken in stages
    )


def _items(lines: Iterable[str]) -> str:
    return "\n".join(f"<li>{html.escape(line)}</li>" for line in lines)


def _packaged(name: str) -> str:
    return (resources.files("lidar_buildings.report") / "page" / name).read_text(encoding="utf-8")


def array_element(name: str, array: NDArray[Any]) -> str:
    """Return the element ``data-…`` of an array of whole numbers or float32, little-endian, row by row."""
    values = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    shape = ",".join(map(str, array.shape))
    return _element(name, array.dtype.name, shape, values.tobytes())


def _element(name: str, kind: str, shape: str, content: bytes) -> str:
    text = base64.b64encode(zlib.compress(content, _LEVEL)).decode()
    facts = f'id="data-{name}" data-type="{kind}" data-shape="{shape}"'
    return f'<script type="text/plain" {facts}>{text}</script>'
