"""What the benchmarks' command lines have in common."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.common.clouds import ROOT
from lidar_buildings.commands.settings import read_settings
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.pipeline.config import STAGE_CONFIGS, PipelineConfig


def data_parser(description: str | None) -> argparse.ArgumentParser:
    """Return a parser with --data."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", help="folder of the real clouds (default: LIDAR_BUILDINGS_DATA)")
    return parser


def parser_of(description: str | None, names: Sequence[str]) -> argparse.ArgumentParser:
    """Return a parser with --data, --methods (one of these names or several) and --set."""
    parser = data_parser(description)
    parser.add_argument(
        "--methods",
        "--method",
        nargs="+",
        choices=names,
        default=names,
        metavar="METHOD",
        help=", ".join(names),
    )
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="NAME=VALUE", help="parameters of this package's methods"
    )
    return parser


def add_scenes(parser: argparse.ArgumentParser, scenes: Iterable[str]) -> None:
    """Let scenes be chosen, and how they are made."""
    every = tuple(scenes)
    parser.add_argument(
        "--scenes", nargs="+", choices=every, default=every, metavar="SCENE", help=", ".join(every)
    )
    parser.add_argument("--rotation", type=float, default=0.0, metavar="DEG", help="turn every scene")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--density", type=float, default=1.0, help="multiple of every scene's own density")


def add_pictures(parser: argparse.ArgumentParser) -> None:
    """Let the disagreements be drawn."""
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="draw the disagreements into this folder"
    )


def picture_folder(folder: Path | None) -> Path | None:
    """Make the folder for pictures; pictures of real data do not belong into the repository."""
    if folder is None:
        return None
    if folder.resolve().is_relative_to(ROOT):
        raise SystemExit(f"--pictures {folder}: lies inside the repository: choose a folder elsewhere")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def config_of(texts: Sequence[str], **defaults: Mapping[str, Any]) -> PipelineConfig:
    """Read STAGE.NAME=VALUE, as a run does; `defaults` are settings by stage."""
    given = _stage_settings(texts)
    settings = {stage: {**defaults.get(stage, {}), **given.get(stage, {})} for stage in STAGE_CONFIGS}
    return PipelineConfig.from_settings(settings)


def settings_of(texts: Sequence[str], stage: str = "ground_filter") -> dict[str, Any]:
    """Read NAME=VALUE of one stage."""
    return _stage_settings([f"{stage}.{text}" for text in texts]).get(stage, {})


def _stage_settings(texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    try:
        return read_settings(None, list(texts))
    except ParameterError as error:
        raise SystemExit(str(error)) from None
