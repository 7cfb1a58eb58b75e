"""Scripts with which shells complete the command line, made of its parser by shtab."""

from __future__ import annotations

import argparse
from pathlib import Path

from lidar_buildings.commands.settings import PRESETS
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.stage_table import STAGES

#: Options with few values that the parser itself leaves open.
_VALUES = {"--preset": PRESETS, "--until": STAGES}
#: What arguments are called that are folders, and other arguments that are files.
_FOLDERS, _FILES = {"DIR", "OLD", "NEW"}, {"INPUT", "RESULT", "REFERENCE", "BAG"}


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return a shell's script; LidarBuildingsError without shtab."""
    try:
        import shtab
    except ImportError:
        raise LidarBuildingsError("shtab, which makes the script, is missing: pip install shtab") from None
    for action in _actions(parser):
        if values := _VALUES.get(action.option_strings[0] if action.option_strings else ""):
            action.choices = values
        elif action.metavar in _FOLDERS:
            action.complete = shtab.DIRECTORY
        elif action.metavar in _FILES or action.type is Path:
            action.complete = shtab.FILE
    script: str = shtab.complete(parser, shell)
    return script


def _actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Return the arguments of a parser and of its commands."""
    found = list(parser._actions)  # argparse tells of them nowhere else, not even shtab
    for one in found[:]:
        if isinstance(one, argparse._SubParsersAction):
            found += [own for command in one.choices.values() for own in _actions(command)]
    return found
