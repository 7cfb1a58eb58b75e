"""What the benchmarks' command lines have in common."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from bench.common.clouds import ROOT
from lidar_buildings.core.model.parameters import StageConfig
from lidar_buildings.core.stages.ground_filter import GroundFilterConfig


def parser_of(description: str | None, names: Sequence[str]) -> argparse.ArgumentParser:
    """Return a parser with --data, --methods (one of these names or several) and --set."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", help="folder of the real clouds (default: LIDAR_BUILDINGS_DATA)")
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


def settings_of(texts: Sequence[str], config: type[StageConfig] = GroundFilterConfig) -> dict[str, Any]:
    """Turn NAME=VALUE into values of the types that a stage's parameters have."""
    defaults = {field.name: field.default for field in fields(config)}
    settings = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name not in defaults:
            raise SystemExit(f"--set {text}: no such parameter; there are {', '.join(defaults)}")
        try:
            settings[name] = _value_of(value, type(defaults[name]))
        except ValueError:
            raise SystemExit(f"--set {text}: must be of type {type(defaults[name]).__name__}") from None
    return settings


def _value_of(text: str, kind: type) -> Any:
    """Read a value of a parameter's type; items of a list are parted by commas."""
    if kind is bool:
        if text not in ("true", "false"):
            raise ValueError(text)
        return text == "true"
    return tuple(filter(None, text.split(","))) if kind is tuple else kind(text)
