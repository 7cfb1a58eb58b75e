"""Sampath and Shan 2007: Table 1, the steps of Figure 4, Figures 5 to 7, and the separation of ground."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely

from bench.common.tables import percent
from bench.ground.isprs import read_samples
from bench.ground.methods import ground_mask
from bench.ground.scenes import made
from bench.ground.scores import score_of_mask
from bench.outlines import table1
from bench.outlines.chain import Building
from bench.outlines.clouds import read_roofs
from bench.outlines.table1 import PAPER, SOME_ASKEW, SURVEYS, Row, Survey, row_of_cloud, row_of_survey
from bench.papers.pages import Section, markdown, spread
from bench.papers.presets import config_of
from lidar_buildings.pipeline.config import PipelineConfig

#: Buildings of figure 4, as in the paper.
N_DRAWN = 3
#: Figures 5 and 6: largest offset and σ of each building [m]; figure 7's numbers are lost in the text.
FIGURES = {
    "Baltimore": ((2.06, 0.43), (2.72, 0.54), (3.71, 0.64), (1.73, 0.36)),
    "Toronto": ((0.82, 0.15), (0.94, 0.12), (1.60, 0.23), (1.11, 0.23)),
}
#: Deviations from a regular pattern, and how often each is drawn.
JITTERS, SEEDS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5), (1, 2)
#: Surveys of table 1.
TABLE_SEEDS = (0, 1, 2)
#: Terrain scenes that are level cities, as the paper's are.
CITIES = ("large_hall", "city_block", "sparse_suburb", "dense_street")


def variants() -> dict[str, PipelineConfig]:
    """Return what is run: the preset and the defaults."""
    return {"as published": config_of("sampath_shan"), "default": PipelineConfig()}


def sections(data: Path, folder: Path | None) -> Iterator[Section]:
    """Measure one table after the other; draw the figures into a folder if one is given."""
    surveys = [one._replace(seeds=TABLE_SEEDS) for one in SURVEYS]
    rows = {name: [row_of_survey(one, configs) for one in surveys] for name, configs in variants().items()}
    askew = {
        name: [row_of_survey(one._replace(rotations=SOME_ASKEW), configs) for one in surveys]
        for name, configs in variants().items()
    }
    real = {name: _clouds(data, configs) for name, configs in variants().items()}
    yield Section("table-1", _table_1(rows, askew, real))
    yield Section("curves", _curves(folder))
    yield Section("separation", _separation(data))
    if folder is not None:
        for row in (*rows["as published"], *real["as published"]):
            _draw(folder / f"sampath_shan_figure_4_{_slug(row.name)}.png", row.buildings[:N_DRAWN])
            _draw_regular(folder / f"sampath_shan_figures_5_to_7_{_slug(row.name)}.png", row.buildings)


def _clouds(data: Path, configs: PipelineConfig) -> list[Row]:
    """Take the ten largest buildings of each cloud that is there."""
    files = {name: sorted((data / name).glob("*.laz")) for name in table1.CLOUDS}
    return [row_of_cloud(read_roofs(name, paths), configs) for name, paths in files.items() if paths]


def _table_1(rows: dict[str, list[Row]], askew: dict[str, list[Row]], real: dict[str, list[Row]]) -> str:
    lines = [
        [f"paper: {name}, as printed", f"{spacing:.2f}", f"{offset / spacing:.2f}", "18–21", "", ""]
        for name, (spacing, offset) in PAPER.items()
    ]
    for name, figures in FIGURES.items():
        offsets, sigmas = np.array(figures).T / PAPER[name][0]
        lines.append(
            [
                f"paper: {name}, four buildings of its figure",
                f"{PAPER[name][0]:.2f}",
                spread(offsets),
                spread(100 * sigmas, 0),
                *("0", "4"),
            ]
        )
    for title, found in (("", rows), (", three of ten askew", askew), ("", real)):
        for variant, surveys in found.items():
            lines += [_cells(f"{row.name}{title}, {variant}", row) for row in surveys]
    headings = (
        "data",
        "spacing [m]",
        "largest offset / spacing",
        "σ / spacing [%]",
        "as traced",
        "buildings",
    )
    return markdown(headings, lines) + "\n\nMean / median / root mean square of the buildings."


def _cells(name: str, row: Row) -> list[str]:
    regular = [one for one in row.buildings if one.is_regular]
    return [
        name,
        f"{row.score.spacing:.2f}",
        spread([one.max_offset / one.spacing for one in regular]),
        spread([100 * one.sigma / one.spacing for one in regular], 0),
        str(row.score.n_as_traced),
        str(len(row.buildings)),
    ]


def _curves(folder: Path | None) -> str:
    """Return σ and largest offset by jitter, with and without GPS time."""
    lines, drawn = [], {}
    for variant, configs in variants().items():
        for has_time in (True, False):
            for survey in SURVEYS:
                found = [
                    row_of_survey(survey._replace(jitter=one, has_time=has_time, seeds=SEEDS), configs)
                    for one in JITTERS
                ]
                name = f"{variant}, {'with' if has_time else 'no'} time"
                sigmas = [100 * row.score.sigma / row.score.spacing for row in found]
                offsets = [row.score.max_offset / row.score.spacing for row in found]
                cells = [f"{s:.0f} / {d:.2f}" for s, d in zip(sigmas, offsets, strict=True)]
                lines.append([name, f"{survey.spacing:g} m × {survey.ratio:g}", *cells])
                drawn[name, survey] = sigmas
    if folder is not None:
        _draw_curves(folder / "sampath_shan_curves.png", drawn)
    headings = ("method", "survey", *(f"jitter {one:g}" for one in JITTERS))
    return markdown(headings, lines) + (
        "\n\nσ / spacing [%], root mean square, and mean largest offset / spacing, of ten buildings parallel "
        f"to the lines, {len(SEEDS)} surveys each."
    )


def _separation(data: Path) -> str:
    """Return the ground filter's errors beside the paper's 97 % of right labels."""
    settings = {"slope_pairs": {"profile_max_slope": 1.0}, "consensus": {}}
    clouds = {f"ISPRS {name}": cloud for name, cloud in read_samples(data / "isprs").items()}
    clouds |= {f"virtual {name}": made(name) for name in CITIES}
    lines = [["paper (Shan and Sampath 2005), cities", "3", "", "", "", "", ""]]
    errors: dict[str, list[list[float]]] = {"slope_pairs": [], "consensus": []}
    for name, cloud in clouds.items():
        cells = [name]
        for method, own in settings.items():
            score = score_of_mask(ground_mask(cloud, method, own), cloud.is_ground)
            figures = [score.total_error, score.type_1_error, score.type_2_error]
            errors[method].append(figures)
            cells += [percent(one) for one in figures]
        lines.append(cells)
    for name, mean in (("mean", np.mean), ("median", np.median)):
        both = [f"{100 * one:.2f}" for found in errors.values() for one in mean(np.array(found), axis=0)]
        lines.append([name, *both])
    headings = ("cloud", "slope pairs: total %", "type I", "type II", "default: total %", "type I", "type II")
    return markdown(headings, lines)


def _slug(name: str) -> str:
    return name.replace(",", "").replace(" ", "_").replace("×", "x")


def _draw(path: Path, buildings: list[Building]) -> None:
    """Draw the ring's points, their convex hull, the traced and the regularised boundary."""
    from bench.common.plotting import plt

    figure, axes = plt.subplots(3, len(buildings), figsize=(7 * len(buildings), 18), squeeze=False)
    for column, one in zip(axes.T, buildings, strict=True):
        traced = one.traced.exterior
        hull = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(traced)))
        for panel, (name, ring) in zip(
            column,
            {"convex hull": hull, "traced": traced, "regularised": one.outline.exterior}.items(),
            strict=True,
        ):
            closed = np.vstack((ring, ring[:1]))
            panel.plot(*traced.T, ".", color="grey", markersize=3)
            panel.plot(*closed.T, color="tab:blue")
            panel.set(aspect="equal", title=f"{name}: d = {one.max_offset:.2f} m, σ = {one.sigma:.2f} m")
    figure.savefig(path, dpi=60, bbox_inches="tight")
    plt.close(figure)


def _draw_regular(path: Path, buildings: list[Building]) -> None:
    """Draw the regularised boundary over the traced points, with d and σ, as the paper's figures 5 to 7."""
    from bench.common.plotting import plt

    figure, axes = plt.subplots(2, 5, figsize=(26, 11))
    for panel, one in zip(axes.flat, buildings, strict=False):
        closed = np.vstack((one.outline.exterior, one.outline.exterior[:1]))
        panel.plot(*one.traced.exterior.T, ".", color="grey", markersize=3)
        panel.plot(*closed.T, color="tab:red")
        panel.set(aspect="equal", title=f"d = {one.max_offset:.2f} m, σ = ±{one.sigma:.2f} m")
    figure.savefig(path, dpi=60, bbox_inches="tight")
    plt.close(figure)


def _draw_curves(path: Path, drawn: dict[tuple[str, Survey], list[float]]) -> None:
    from bench.common.plotting import plt

    figure, panels = plt.subplots(1, len(SURVEYS), figsize=(6 * len(SURVEYS), 4.5), sharey=True)
    for panel, survey in zip(panels, SURVEYS, strict=True):
        panel.axhspan(18, 21, color="0.9")
        for (name, own), sigmas in drawn.items():
            if own == survey:
                panel.plot(JITTERS, sigmas, label=name, linestyle="-" if "with" in name else "--")
        panel.set(
            title=survey.name, xlabel="jitter [cells]", ylabel="σ / spacing [%] (grey: paper)", ylim=(0, None)
        )
    panels[0].legend()
    figure.savefig(path, dpi=80, bbox_inches="tight")
    plt.close(figure)
