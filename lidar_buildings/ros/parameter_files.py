"""
Parameter files on a node's command line, looked at before ROS does: its own complaint takes several lines.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import yaml

from lidar_buildings.core.model.errors import InputError

_OPTION = "--params-file"


def check_parameter_files(arguments: Sequence[str]) -> None:
    """
    Look at every file that ``--params-file`` names.

    Raises
    ------
    InputError
        If one cannot be read, or is not of the form that ROS takes: one line.
    """
    for path in _named(arguments):
        try:
            # parsed, not constructed: launch files tag lists as Python's tuples, which ROS takes as lists
            content = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}: give {_OPTION} a readable YAML file") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            place = " ".join(str(error).split())
            raise InputError(f"{path}: not valid YAML ({place}): compare pipeline.param.yaml") from error
        if content is not None and not isinstance(content, yaml.MappingNode):
            raise InputError(f"{path}: no node names at its top: compare pipeline.param.yaml")


def _named(arguments: Sequence[str]) -> Iterator[Path]:
    for option, value in pairwise(arguments):
        if option == _OPTION:
            yield Path(value)
