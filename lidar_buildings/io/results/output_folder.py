"""The output folder of a run: tiles as they come, and at the end the files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
import shapely

from lidar_buildings import __version__
from lidar_buildings.core.model.ids import tile_of
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.remarks import Remark, gathered
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.io.clouds.agreement import crs_with_heights
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.locations import state_of
from lidar_buildings.io.files.reference_systems import about_units, model_frame
from lidar_buildings.io.results.classified_files import write_clouds
from lidar_buildings.io.results.output_config import OUTPUT_FORMATS, REPORT, REPORT_FILE, OutputConfig
from lidar_buildings.io.results.run_folder import (
    FINISHED,
    PARTIAL,
    RUN,
    Share,
    Use,
    claim_folder,
    files_of_run,
    remove_files,
)
from lidar_buildings.io.results.run_summary import (
    BuildingCounts,
    RunSummary,
    run_record,
    unlikely_building,
    unlikely_shares,
)
from lidar_buildings.io.results.survey_buildings import SurveyBuildings, seam_pieces
from lidar_buildings.io.results.tile_products import (
    TileProducts,
    load_facades,
    load_outlines,
    load_raster_window,
    load_shapes,
    load_stamp,
)

if TYPE_CHECKING:  # what reads them takes time to import
    from lidar_buildings.core.stages.facades.facade import Facade
    from lidar_buildings.io.vectors.footprints import FootprintFile

_ENDING = ".npz"
#: File among the tiles in which the models' lines wait for their turn.
_LINES = "features.jsonl"
#: A tile's stages see points so far from it at most, unless a parameter was changed [m].
_REACH = 200.0
#: Last stage of a run that ends before there are outlines, or before there are models.
_WITHOUT_OUTLINES = STAGES[: STAGES.index("boundary_tracing")]
_WITHOUT_MODELS = STAGES[: STAGES.index("building_model")]


class OutputFolder:
    """
    Takes a run's tiles in any order, safe on disk one by one, and makes the files from them at the end.

    A point's `source` is its file's place in `inputs`. An unfinished run of the same inputs and parameters
    is resumed, with `overwrite`, too. Files that a stage after `until` would fill are not made. If the run is
    live the files are made from the tiles there are, as often as one likes, and `inputs` are named before
    that. `on_disk` leads from the stamp of a tile's first revision to that of the one on disk [ns].
    OutputError if the folder cannot be used.
    """

    def __init__(
        self,
        path: str | Path,
        inputs: Sequence[InputFile],
        frame: MapFrame,
        *,
        overwrite: bool = False,
        until: str = "building_model",
        parameters: Mapping[str, Any] | None = None,
        footprints: FootprintFile | None = None,
        files: OutputConfig | None = None,
        is_live: bool = False,
        use: Use = Use.NONE,
    ) -> None:
        self.path = Path(path)
        self.inputs = list(inputs)
        self.frame = frame
        self.until = until
        self._files = files or OutputConfig()
        self.is_live = is_live
        self._footprints = footprints
        identity = {
            "version": __version__,
            "inputs": [
                [str(file.path.resolve()), file.point_count, (file.state or state_of(file.path))[1]]
                for file in self.inputs
            ],
            "frame": asdict(frame),
            "until": until,
            "parameters": dict(parameters or {}),
        }
        self._bags = identity["parameters"].get("bags", ())
        claim_folder(self.path, identity, self.inputs, overwrite=overwrite, is_live=is_live, use=use)
        self._use = use
        self.on_disk: dict[int, int] = {}
        for fragment in self._partial.glob(f"*{_ENDING}"):
            # A killed process leaves a part, under another name; a power cut a name without its content.
            try:
                self.on_disk[int(fragment.stem)] = load_stamp(fragment)
            except (OSError, ValueError, KeyError, EOFError, RuntimeError, BadZipFile):
                fragment.unlink()

    def write_tile(self, products: TileProducts) -> None:
        """Put a tile on disk in the place of any revision of it; OutputError if it cannot be written."""
        products.save(self.tile_path(products.stamp))
        self.on_disk[tile_of(products.stamp)] = products.stamp

    def tile_path(self, stamp: int) -> Path:
        """Return where a tile is put on disk, for a process that saves it itself."""
        return self._partial / f"{tile_of(stamp)}{_ENDING}"

    def keep_only(self, stamps: Collection[int]) -> None:
        """Delete tiles on disk that are none of some; files that were made of them stay."""
        known = {tile_of(stamp) for stamp in stamps}
        for fragment in self.saved_tiles():
            if int(fragment.stem) not in known:
                fragment.unlink()
                self.on_disk.pop(int(fragment.stem), None)

    def load_writers(self) -> None:
        """Import what `finalise` needs, in a time when nothing else is to be done."""
        from lidar_buildings.io.results import terrain_files  # noqa: F401
        from lidar_buildings.io.results.building_files import writer_of

        for name in OUTPUT_FORMATS.keys() & set(self._files.formats):
            writer_of(name)

    def finalise(
        self,
        run_info: Mapping[str, Any] | None = None,
        share: Share = map,
        told_of: Collection[int] = (),
        *,
        has_failed: bool = False,
        write_report: Callable[[Path, dict[str, Any]], Any] | None = None,
    ) -> RunSummary:
        """
        Make the files from the tiles on disk; ``run.json`` comes last, then the tiles are deleted.

        Tiles of a live run stay, and those of one that is not finished, as tiles failed or an input is no
        longer there: the same run goes on with them, and makes anew what lacks that input's points. Each file
        replaces its predecessor when it is complete. The result does not depend on the order in which the
        tiles came.

        `run_info` is what else ``run.json`` holds; its ``problems`` stand before those met here, where the
        inputs in `told_of` are not reported again, and its ``remarks`` before those of the inputs and those
        met here. `share`, as `map`, may write the classified clouds in other processes. `write_report` writes
        the page of the folder with the content of ``run.json``.
        OutputError if a file cannot be written; the tiles are kept, and the run can be resumed.
        """
        from lidar_buildings.io.results.terrain_files import write_rasters  # see `load_writers`

        info = dict(run_info or {})
        fragments = self.saved_tiles()
        # footprints are what they are, also where one lies within another
        pieces = set() if self._footprints else seam_pieces([load_outlines(one) for one in fragments])
        crs = crs_with_heights(self.inputs, self.frame)
        with ThreadPoolExecutor(2) as beside:
            cloud_files = beside.submit(
                write_clouds,
                self.path,
                self.inputs,
                fragments,
                without=pieces,
                share=share,
                frame=self.frame,
            )
            raster_files = beside.submit(write_rasters, self.path, fragments, self.frame, crs)
            facades = sorted(
                (one for fragment in fragments for one in load_facades(fragment)),
                key=lambda one: (*one.foot.ravel().tolist(), one.bottom),
            )
            buildings, counts, remarks = self._write_buildings(fragments, pieces, crs, facades)
            clouds, (rasters, problems) = cloud_files.result(), raster_files.result()
        outputs = [one.output for one in clouds]
        missing = [
            file for file, one in zip(self.inputs, clouds, strict=True) if one.output is None and file.is_away
        ]
        is_finished = not (has_failed or missing)
        if missing:
            text = f"the run is not finished: repeat the command when {missing[0].path} is there again"
            remarks.append(Remark("not_finished", text))
        of_inputs = [remark for one in self.inputs for remark in one.remarks]
        of_bags = [Remark("bag", f"{bag['bag']}: {text}") for bag in self._bags for text in bag["warnings"]]
        files = [*filter(None, outputs), *buildings]
        new = [one.problem for source, one in enumerate(clouds) if one.problem and source not in told_of]
        per_class = sum((one.per_class for one in clouds), np.zeros(256, dtype=np.int64))
        n_points = sum(file.point_count for file in self.inputs)
        report = (REPORT_FILE,) if write_report and REPORT in self._files.formats else ()
        footprints = dict(self._footprints.record) if self._footprints else {}
        if footprints:
            footprints["n_outside"] = footprints["n_used"] - counts.total
        of_inputs += [remark for one in clouds for remark in one.remarks]
        found = {int(code): int(per_class[code]) for code in np.flatnonzero(per_class)}
        filtered = info.get("parameters", {}).get("ground_filter", {})
        if self.until != STAGES[0] and filtered.get("method") != "none":
            remarks = [*unlikely_shares(found), *remarks]
        summary = RunSummary(
            files=(*files, *rasters, *report, RUN),
            n_tiles=len(fragments),
            n_points=n_points,
            n_unclassified=n_points - sum(one.n_known for one in clouds),
            n_facade=sum(one.n_facade for one in clouds),
            n_street=sum(one.n_street for one in clouds),
            n_covered=sum(one.n_covered for one in clouds),
            facade_count=len(facades),
            facade_length=round(sum(one.length * one.seen_share for one in facades), 3),
            classes=found,
            buildings=dict(sorted(counts.statuses.items())),
            quality=dict(sorted(counts.grades.items())),
            quality_reasons=dict(sorted(counts.causes.items())),
            n_seam_pieces=len(pieces),
            rasters=rasters,
            problems=tuple(dict.fromkeys([*info.get("problems", ()), *new, *problems])),
            footprints=footprints,
            remarks=gathered([*info.get("remarks", ()), *of_bags, *of_inputs, *remarks]),
        )
        outdated = set(files_of_run(self.path)) - set(summary.files)
        named = [
            {
                "path": str(file.path),
                "point_count": file.point_count,
                "output": output,
                **({"n_street": cloud.n_street} if cloud.n_street else {}),
            }
            for file, output, cloud in zip(self.inputs, outputs, clouds, strict=True)
        ]
        own = {"inputs": named, "until": self.until, "frame": asdict(self.frame), FINISHED: is_finished}
        run = run_record(own, summary, info)
        if write_report and report:
            write_report(self.path, run)
        with atomic_file(self.path / RUN) as temporary:
            temporary.write_text(json.dumps(run, indent=2, default=str) + "\n", encoding="utf-8")
        if self.is_live or not is_finished or self._use is Use.UPDATE:
            remove_files(self.path, outdated)
            areas = [shapely.box(*file.area) for file in missing if file.area]
            for fragment in fragments if areas else ():
                if _may_reach(fragment, areas):
                    fragment.unlink()
                    self.on_disk.pop(int(fragment.stem), None)
            (self._partial / _LINES).unlink(missing_ok=True)
        else:
            shutil.rmtree(self._partial)
        return summary

    @property
    def _partial(self) -> Path:
        return self.path / PARTIAL

    def saved_tiles(self) -> list[Path]:
        """Return where the tiles on disk are, by rising stamp."""
        found = [one for one in self._partial.glob(f"*{_ENDING}") if one.stem.isdigit()]
        return sorted(found, key=lambda one: int(one.stem))

    def _write_buildings(
        self, fragments: list[Path], pieces: set[int], crs: str, facades: list[Facade]
    ) -> tuple[list[str], BuildingCounts, list[Remark]]:
        """Write outlines and models as far as the run went; return file names, counts, remarks."""
        from lidar_buildings.core.stages.building_model.model import LOD22
        from lidar_buildings.io.results.building_files import model_heading, write_buildings, write_in_blocks
        from lidar_buildings.io.results.terrain_files import terrain_meshes

        names = None if self._footprints is None else self._footprints.footprint_id
        formats = self._files.formats
        if self.until in _WITHOUT_MODELS:
            of_outlines = () if self.until in _WITHOUT_OUTLINES else OUTPUT_FORMATS
            formats = tuple(name for name in of_outlines if name in formats and of_outlines[name].of_outlines)
        files = replace(self._files, formats=formats)
        heading, remarks = model_heading(self.inputs, self.frame, crs, files)
        with SurveyBuildings(
            self._partial / _LINES,
            model_frame(self.frame),
            without=pieces,
            footprint_id=names,
            names=files.attributes,
        ) as buildings:
            for fragment in fragments:
                buildings.add(load_shapes(fragment))
            total = sum(file.point_count for file in self.inputs)
            remarks += unlikely_building(*reversed(buildings.largest), total)
            remarks += about_units(self.frame, buildings.bounds)
            coarse = [f"{n:,} at LoD{lod}" for lod, n in sorted(buildings.levels.items()) if lod < LOD22]
            if coarse:
                text = f"coarser than LoD{LOD22}: {', '.join(coarse)}: their `reason` says why"
                remarks.append(Remark("coarser_models", text))
            terrain = terrain_meshes(fragments, self.frame, self._files.terrain_tolerance)
            write = write_buildings
            if len(buildings) > self._files.max_buildings_per_file:
                write = partial(write_in_blocks, largest=self._files.max_buildings_per_file)
            return *write(self.path, buildings, formats, heading, terrain, facades), remarks


def _may_reach(fragment: Path, areas: Sequence[shapely.Polygon]) -> bool:
    """Whether a saved tile may have seen points of some areas; one without rasters may."""
    window = load_raster_window(fragment)
    if window is None or not window.width or not window.height:
        return True
    west, north = window.corner
    width, height = window.width * window.resolution, window.height * window.resolution
    own = shapely.box(west, north - height, west + width, north)
    return bool(shapely.dwithin(own, areas, _REACH).any())
