"""Scripts with which shells complete the command line, made of its parser by shtab."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lidar_buildings.commands.settings import PRESETS
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.stage_table import STAGES

#: Options with few values that the parser itself leaves open.
_VALUES = {"--preset": PRESETS, "--until": STAGES}
#: What arguments are called that are folders, and other arguments that are files.
_FOLDERS, _FILES = {"DIR", "OLD", "NEW"}, {"INPUT", "RESULT", "REFERENCE", "BAG"}


class _Completed(argparse.Action):
    """An argument whose values shtab knows; it is never parsed."""

    def __init__(self, option_strings: list[str], dest: str, **told: Any) -> None:
        import shtab

        super().__init__(option_strings, dest, **told)
        if values := _VALUES.get(option_strings[0] if option_strings else ""):
            self.choices = values
        elif self.metavar in _FOLDERS:
            self.complete = shtab.DIRECTORY
        elif self.metavar in _FILES or self.type is Path:
            self.complete = shtab.FILE


def completion_script(
    make_parser: Callable[[type[argparse.Action]], argparse.ArgumentParser], shell: str
) -> str:
    """Return a shell's script for the parser made with an action to store values; error without shtab."""
    try:
        import shtab
    except ImportError:
        raise LidarBuildingsError("shtab, which makes the script, is missing: pip install shtab") from None
    script: str = shtab.complete(make_parser(_Completed), shell)
    return script
