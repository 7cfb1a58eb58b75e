"""
Where numba keeps the compiled loops: a folder for each state of their sources, and for each numba and Python.

Numba looks only at a loop's own file: it would reuse a loop that contains an older version of another file's
loop. A user's NUMBA_CACHE_DIR is kept; if it is set but empty, numba uses its own places.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from importlib import metadata
from pathlib import Path

TEXT = "compiling the loops, once after an installation"
_PACKAGE = Path(__file__).parents[1]
#: Compiles with the search path of this process: the current folder is not searched.
_COMPILE = """
import sys
sys.path[:] = sys.argv[1:]
from lidar_buildings.commands.warm_up import compile_loops
compile_loops()
"""
#: Folders of the package that have compiled loops.
_WITH_LOOPS = ("core", "simulation")
#: Folders of earlier states that are left: processes may still run with them.
_N_KEPT = 2


def use_kernel_folder() -> None:
    """Let numba keep what it compiles in the package's folder for it."""
    if "NUMBA_CACHE_DIR" not in os.environ:
        os.environ["NUMBA_CACHE_DIR"] = str(_choose_folder())
        if "numba" in sys.modules:
            sys.modules["numba"].config.reload_config()


def kernel_folder() -> Path | None:
    """Return the folder; None where numba chooses places itself."""
    name = os.environ.get("NUMBA_CACHE_DIR")
    return Path(name) if name else None


def marker() -> Path | None:
    """Return the file whose presence says that all loops are compiled; None where numba chooses places."""
    folder = kernel_folder()
    return None if folder is None else folder / f"lidar_buildings-{_state()}.complete"


def is_compiled() -> bool:
    """Whether all loops are compiled, or numba chooses places itself."""
    complete = marker()
    return complete is None or complete.exists()


def start_compiling() -> subprocess.Popen[bytes] | None:
    """Compile all loops in a process that reports progress on stderr; None if they are compiled."""
    if is_compiled():
        return None
    # Not with -m, which would find another copy of the package in the current folder.
    return subprocess.Popen([sys.executable, "-c", _COMPILE, *sys.path])


def remove_earlier_folders() -> None:
    """Remove the folders of all but the latest states of the sources, beside the one in use."""
    folder = kernel_folder()
    if folder is None or not folder.name.startswith("kernels-"):
        return
    others = [one for one in folder.parent.glob("kernels-*") if one != folder]
    for one in sorted(others, key=lambda one: one.stat().st_mtime)[:-_N_KEPT]:
        shutil.rmtree(one, ignore_errors=True)


@cache
def _state() -> str:
    """Return a hash of all files with loops, and of what compiles them: numba keeps loops of one version."""
    compiler = metadata.version("numba"), platform.processor(), sys.implementation.cache_tag
    found = hashlib.sha256(repr(compiler).encode())
    for room in _WITH_LOOPS:
        for path in sorted((_PACKAGE / room).rglob("*.py")):
            source = path.read_bytes()
            if any(word in source for word in (b"core.kernels import", b"njit", b"numba")):
                found.update(str(path.relative_to(_PACKAGE)).encode() + b"\0" + source)
    return found.hexdigest()[:16]


def _choose_folder() -> Path:
    """Return the first of these that can be written: in the installation, in the home, a temporary one."""
    name = f"kernels-{_state()}"
    installed = _PACKAGE / "__pycache__" / name
    if _is_writable(installed):
        return installed
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "lidar_buildings" / name
    folder = home if _is_writable(home) else Path(tempfile.mkdtemp(prefix="lidar_buildings-"))
    if installed.is_dir() and not any(folder.iterdir()):  # shipped with the installation
        shutil.copytree(installed, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.complete"))
        for complete in installed.glob("*.complete"):
            shutil.copy(complete, folder)
    return folder


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
