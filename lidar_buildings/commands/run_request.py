"""What the user of ``lidar-buildings run`` asks for, checked before anything is touched."""

from __future__ import annotations

import argparse
import json
import re
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from lidar_buildings.commands.settings import CONFIGS, Settings, preset_file, read_settings
from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.core.model.parameters import StageConfig
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.stages.footprints.config import FootprintConfig
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.results.output_config import OutputConfig
from lidar_buildings.io.results.run_folder import Use
from lidar_buildings.io.tiling.tiling_config import TilingConfig
from lidar_buildings.nodes.table import NODE_STAGES
from lidar_buildings.pipeline.config import STAGE_CONFIGS, PipelineConfig

if TYPE_CHECKING:
    from lidar_buildings.io.vectors.footprints import FootprintSource

Config = TypeVar("Config", bound=StageConfig)

_TILING = TilingConfig.stage
#: Parameters of nodes that the command sets itself, and by what the user tells it.
_OWN = {
    (_TILING, "input"): "INPUT",
    (_TILING, "wait_for"): "--until",
    ("model_writer", "input"): "INPUT",
    ("model_writer", "output"): "--output",
    ("model_writer", "overwrite"): "--overwrite",
    ("model_writer", "until"): "--until",
    ("model_writer", "settings"): "--set and --params",
    ("model_writer", "footprints"): "--footprints",
    ("model_writer", "footprints_layer"): "--footprints-layer",
    ("model_writer", "footprint_id"): "--footprint-id",
    (_TILING, "crs"): "--crs",
    ("model_writer", "crs"): "--crs",
    ("footprints", "file"): "--footprints",
    ("footprints", "layer"): "--footprints-layer",
    ("flow_control", "publish_tile_done"): "--output",
    ("recorder", "output"): "--record",
}
#: A namespace of ROS: words of letters, digits and underscores that begin with no digit.
_NAMESPACE = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True)
class RunRequest:
    """What the user asked for, checked."""

    inputs: tuple[str, ...]  #: files, folders, globs
    output: Path  #: the output folder
    settings: Settings  #: what differs from the defaults, by stage
    config: PipelineConfig  #: all stages' configs
    tiling: TilingConfig  #: how the input is cut
    files: OutputConfig  #: which files are made, and how ground and surface are rasterised
    until: str  #: the last stage
    overwrite: bool  #: whether earlier results may be replaced
    namespace: str | None  #: ROS namespace, None for one of its own
    footprints: FootprintSource | None = None  #: where given footprints come from, None to trace outlines
    scans: ScanConfig = field(default_factory=ScanConfig)  #: how the scans of bags are placed
    choice: BagConfig = field(default_factory=BagConfig)  #: what of bags is taken
    bags: tuple[dict[str, Any], ...] = ()  #: what became of the bags among the inputs, once they are placed
    preset: str = ""  #: the paper whose parameters these are, but for what the user set; empty if none
    use: Use = Use.NONE  #: what is wanted of a finished run in the output folder
    is_quiet: bool = False  #: whether no progress is shown
    crs: str = ""  #: reference system of inputs that name none
    #: West, south, east and north of the points that are wanted, in the coordinates of the inputs.
    bounds: tuple[float, ...] | None = None
    #: Input → where it came from, once those elsewhere are here, and all are cut to bounds.
    fetched: dict[str, str] = field(default_factory=dict)

    def parameters(self) -> dict[str, Any]:
        """Return everything that results depend on, as plain values."""
        stages = {
            **asdict(self.config),
            _TILING: asdict(self.tiling),
            OutputConfig.stage: asdict(self.files),
            **({"bags": list(self.bags)} if self.bags else {}),
            **({"preset": self.preset} if self.preset else {}),
        }
        if self.footprints is None:
            return stages
        given = self.footprints
        file = {"file": str(given.path.resolve()), "layer": given.layer, "id_column": given.id_column}
        changed = {"changed": given.path.stat().st_mtime_ns}
        return stages | {FootprintConfig.stage: stages[FootprintConfig.stage] | file | changed}


def request_of(options: argparse.Namespace) -> RunRequest:
    """
    Check the options of the command line.

    InputError if the parameter file cannot be read, ParameterError if a name is unknown or a value not
    allowed.
    """
    assignments = [*options.set, *_short_forms(options)]
    preset = preset_file(options.preset) if options.preset else None
    settings = read_settings(options.params, assignments, preset=preset)
    if options.tile_size is not None:
        settings.setdefault(_TILING, {})["tile_size"] = options.tile_size
    _check_own(settings)
    for stage in (_TILING, "model_writer") if options.crs else ():
        settings.setdefault(stage, {})["crs"] = options.crs
    if options.record is not None:
        if options.no_ros:
            raise ParameterError("--record: recording needs ROS: remove --no-ros or --record")
        from lidar_buildings.io.bags.bag_writer import Recording, bag_folder  # takes time to import

        settings.setdefault("recorder", {})["output"] = str(Recording(bag_folder(options.record)).path)
    if options.namespace is not None and not _NAMESPACE.fullmatch(options.namespace):
        raise ParameterError(
            f"--namespace {options.namespace!r}: must be names of letters, digits and _, not starting with a "
            "digit, separated by /"
        )
    if options.bounds is not None:
        west, south, east, north = options.bounds
        if not (west < east and south < north):
            said = " ".join(f"{edge:.12g}" for edge in options.bounds)
            raise ParameterError(f"--bounds {said}: must be WEST SOUTH EAST NORTH")
    footprints = _footprints(options, settings)
    return RunRequest(
        inputs=tuple(options.input),
        output=options.output,
        settings=settings,
        config=PipelineConfig(**{stage: _shared(kind, settings) for stage, kind in STAGE_CONFIGS.items()}),
        tiling=_shared(TilingConfig, settings),
        files=_shared(OutputConfig, settings),
        until=_last_stage(options.until),
        overwrite=options.overwrite,
        namespace=options.namespace,
        footprints=footprints,
        scans=_shared(ScanConfig, settings),
        choice=_shared(BagConfig, settings),
        preset=options.preset or "",
        use=Use.UPDATE if options.update else Use.RETRY if options.retry_failed else Use.NONE,
        is_quiet=options.quiet or options.json,
        crs=options.crs or "",
        bounds=None if options.bounds is None else tuple(options.bounds),
    )


def _short_forms(options: argparse.Namespace) -> list[str]:
    if options.rate is not None and options.no_ros:
        raise ParameterError("--rate: needs ROS: remove --no-ros or --rate")
    forms = [f"{ScanConfig.stage}.georeferenced=true"] if options.georeferenced else []
    if options.attributes is not None:
        forms.append(f"{OutputConfig.stage}.attributes={options.attributes}")
    if options.geoid is not None:
        forms.append(f"{OutputConfig.stage}.{_geoid(options.geoid)}")
    named = {name: getattr(options, name) for name in ("rate", *(one.name for one in fields(BagConfig)))}
    told = {name: value for name, value in named.items() if value is not None}
    return forms + [f"{_TILING}.{name}={json.dumps(value)}" for name, value in told.items()]


def _geoid(given: str) -> str:
    """Return the parameter that a height or a grid of the geoid sets; InputError if PROJ reads no grid."""
    try:
        return f"geoid_height={float(given)}"
    except ValueError:
        from lidar_buildings.io.files.reference_systems import geoid_of_grid  # takes time to import

        grid = str(Path(given).resolve()) if Path(given).exists() else given
        geoid_of_grid(grid)
        return f"geoid_grid={json.dumps(grid)}"


def _footprints(options: argparse.Namespace, settings: Settings) -> FootprintSource | None:
    """Return where footprints come from, and have them used."""
    layer, column = options.footprints_layer, options.footprint_id
    if options.footprints is None:
        if layer is not None or column is not None:
            option = "--footprints-layer" if layer is not None else "--footprint-id"
            raise ParameterError(f"{option}: needs --footprints FILE")
        return None
    if not options.footprints.exists():
        raise InputError(f"{options.footprints}: no such file: check the path of --footprints")
    from lidar_buildings.io.vectors.footprints import FootprintSource  # what reads them takes time to import

    source = FootprintSource(options.footprints, layer or "", column or "")
    settings.setdefault(FootprintConfig.stage, {}).update(file=str(source.path), layer=source.layer)
    settings.setdefault(RegularisationConfig.stage, {})["keep_outlines"] = True
    settings.setdefault("model_writer", {}).update(
        footprints=str(source.path), footprints_layer=source.layer, footprint_id=source.id_column
    )
    return source


def _check_own(settings: Settings) -> None:
    """Refuse what the command sets itself, and what a run that writes files cannot work with."""
    for (stage, name), option in _OWN.items():
        default = next(member.default for member in fields(CONFIGS[stage]) if member.name == name)
        if settings.get(stage, {}).pop(name, default) != default:
            raise ParameterError(f"{stage}.{name} is set by {option}: remove the parameter")
    if settings.get(_TILING, {}).get("max_tiles_in_flight") == 0:
        raise ParameterError(
            f"{_TILING}.max_tiles_in_flight = 0: must be at least 1 for a run that writes files"
        )


def _shared(config: type[Config], settings: Settings) -> Config:
    """Return what nodes and the local run share of a node's parameters; the others only nodes have."""
    names = {member.name for member in fields(config)}
    values = settings.get(config.stage, {})
    return config(**{name: value for name, value in values.items() if name in names})


def _last_stage(until: str | None) -> str:
    """Return the stage to end with; the name of a node stands for its stage."""
    if until is None:
        return STAGES[-1]
    other_names = NODE_STAGES | {"segmentation": "boundary_tracing"}
    stage = until if until in STAGES else other_names.get(until, "")
    if not stage:
        raise ParameterError(f"--until {until}: must be one of {', '.join(STAGES)}")
    return stage
