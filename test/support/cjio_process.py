"""cjio in a process of its own: imported, it changes how the standard library writes floats as JSON."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Iterable

import pytest


def cjio(*arguments: str, lines: Iterable[str]) -> subprocess.CompletedProcess:
    """Run cjio on a CityJSONSeq."""
    if importlib.util.find_spec("cjio") is None:
        pytest.skip("cjio is not installed")
    command = [sys.executable, "-c", "from cjio.cjio import cli; cli()", *arguments]
    return subprocess.run(command, input="\n".join(lines) + "\n", capture_output=True, text=True, timeout=120)
