"""Which output folders may be used, and what becomes of what stands in them."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.failures import one_line
from lidar_buildings.io.results.output_config import FORMAT_FILES, REPORT_FILE

if TYPE_CHECKING:
    from lidar_buildings.io.clouds.find_inputs import InputFile

#: Calls a function for each of some jobs.
Share = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]


class Use(Enum):
    """What is wanted of a finished run whose tiles are still there: nothing, or that it goes on."""

    NONE = "none"
    #: Tiles that failed are done again.
    RETRY = "--retry-failed"
    #: Tiles whose points have changed are done again, and all stay for the next time.
    UPDATE = "--update"


PARTIAL = ".partial"
#: Folder in it with the clouds that were made of bags.
PLACED = "placed"
#: Folder in it with the points of tiles that workers read, and file that keeps other runs away.
_POINTS, LOCK = "points", "lock"
#: What in it is there for the run that begins.
_NOT_OF_RUN = (PLACED, _POINTS, LOCK)
RUN = "run.json"
#: What in it says whether the run is finished.
FINISHED = "is_finished"
CLASSIFIED = "classified"
#: Folder with the files of buildings where there are too many for one each.
BLOCKS = "blocks"
DTM, DSM, NDSM = "dtm.tif", "dsm.tif", "ndsm.tif"
#: Beside them where the ground is kriged.
DTM_VARIANCE = "dtm_variance.tif"
#: What parts of an identity are called.
_WORDS = {"until": "--until", "version": "versions of this package"}
#: What identifies the unfinished run, beside its tiles.
_IDENTITY, _SURVEY = "identity.json", "survey.json"


def claim_folder(
    path: Path,
    identity: dict[str, Any],
    inputs: Sequence[InputFile],
    *,
    overwrite: bool,
    is_live: bool = False,
    use: Use = Use.NONE,
) -> None:
    """
    Make a folder ready for a run, or for taking up the same run where it was left.

    `identity` is equal for the same run: inputs, parameters, last stage. Inputs must not lie where the
    results will. If `overwrite` an earlier run's files may be replaced, never those of other origin; the same
    unfinished run is resumed in any case. A live run replaces its own files; without tiles on disk it may
    become another one, as its source was reset. A finished run that is updated may have other inputs than
    before. OutputError if the folder cannot be used.
    """
    for file in inputs:
        if (path / CLASSIFIED).resolve() in file.path.resolve().parents:
            raise OutputError(f"{path}: contains the input {file.path}: choose another output folder")
    check_folder(path, overwrite=overwrite or use is not Use.NONE, is_live=is_live)
    with usable(path):
        has_tiles = any((path / PARTIAL).glob("*.npz"))
        if use is not Use.NONE:
            _check_use(path, identity, use)
        elif overwrite:
            if not _is_same(path, identity):
                _clear(path)
        elif _holds_run(path) and not _is_same(path, identity) and (not is_live or has_tiles):
            raise OutputError(
                f"{path}: contains an unfinished run with other inputs or parameters{_away(path, inputs)}: "
                "give the same to resume it, --overwrite to start over, or another folder"
            )
        (path / PARTIAL).mkdir(exist_ok=True)
        try:
            with atomic_file(path / PARTIAL / _IDENTITY) as temporary:
                temporary.write_text(json.dumps(identity))
        except OutputError as error:
            raise error.__cause__ or error from None  # nothing is done yet that could be taken up


def check_folder(path: Path, *, overwrite: bool, is_live: bool = False) -> None:
    """Make a folder, or refuse (OutputError) one that holds else than an unfinished, or a live, run."""
    with usable(path):
        path.mkdir(parents=True, exist_ok=True)
        if overwrite:
            return
        if (path / RUN).exists() and not (_holds_run(path) and (is_live or not _is_finished(path))):
            raise OutputError(
                f"{path}: contains a finished run: give --overwrite to do it again, or another folder"
            )
        if not _holds_run(path) and any(file.name != PARTIAL for file in path.iterdir()):
            raise OutputError(f"{path}: is not empty: give --overwrite to write into it, or another folder")


def output_names(inputs: Sequence[InputFile]) -> list[str]:
    """Return a name without ending for each input's output; equal names are told apart by a number."""
    taken: set[str] = set()
    names = []
    for file in inputs:
        stem = file.path.stem.removesuffix(".copc")
        number, name = 1, stem
        while name.lower() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.lower())
        names.append(name)
    return names


def _holds_run(path: Path) -> bool:
    """Whether there is an unfinished run; a folder that a full disk kept empty is none."""
    return any(one.name not in _NOT_OF_RUN for one in (path / PARTIAL).glob("*"))


def _is_finished(path: Path) -> bool:
    return bool((_read(path / RUN) or {}).get(FINISHED, True))


def _check_use(path: Path, identity: dict[str, Any], use: Use) -> None:
    """Refuse to go on with a run of other parameters, or of other inputs where tiles are to be retried."""
    earlier, new = _read(path / PARTIAL / _IDENTITY), json.loads(json.dumps(identity))
    if earlier is None:
        if use is Use.RETRY:
            raise OutputError(f"{path}: {use.value}: contains no run with failed tiles: remove {use.value}")
        if not (path / RUN).exists() and any(one.name != PARTIAL for one in path.iterdir()):
            raise OutputError(f"{path}: is not empty and contains no run: choose another folder")
        _clear(path)
        return
    changing = {"inputs", "frame"} if use is Use.UPDATE else set()
    for name in sorted(new.keys() - changing):
        if earlier.get(name) != new[name]:
            raise OutputError(
                f"{path}: {use.value}: its run used other {_WORDS.get(name, name)}: give the same, "
                "or --overwrite to start over"
            )


def _away(path: Path, inputs: Sequence[InputFile]) -> str:
    """Name an input of the run in a folder that is none of some."""
    now = {file.path.resolve() for file in inputs}
    away = [one for one in inputs_of_run(path) if one not in now]
    return f" ({away[0]} was one of them)" if away else ""


def _is_same(path: Path, identity: dict[str, Any]) -> bool:
    return _read(path / PARTIAL / _IDENTITY) == json.loads(json.dumps(identity))


def discard_unfinished(path: Path) -> None:
    """Delete the tiles of an unfinished run, so that the next one begins anew."""
    for one in (path / PARTIAL).glob("*"):
        if one.is_dir():
            shutil.rmtree(one, ignore_errors=True)
        elif one.name != LOCK:
            with suppress(OSError):
                one.unlink()


def inputs_of_run(path: Path) -> list[Path]:
    """Return the inputs of a run whose tiles are there, in their order."""
    return [Path(file[0]) for file in (_read(path / PARTIAL / _IDENTITY) or {}).get("inputs", [])]


def recall_survey(path: Path) -> Any:
    """Return what `note_survey` noted, None if nothing."""
    return _read(path / PARTIAL / _SURVEY)


def note_survey(path: Path, known: Any) -> None:
    """Note what was learnt of a survey for the time when it is brought up to date."""
    with atomic_file(path / PARTIAL / _SURVEY) as temporary:
        temporary.write_text(json.dumps(known))


def folder_of_points(path: Path) -> Path:
    """Make an empty folder for points in an output folder, where other machines see it, or OutputError."""
    folder = path / PARTIAL / _POINTS
    shutil.rmtree(folder, ignore_errors=True)  # of a run that was interrupted
    with usable(path):
        folder.mkdir(parents=True)
    return folder


def add_to_run(path: Path, more: dict[str, Any]) -> None:
    """Add to what ``run.json`` tells; OutputError if it cannot be written."""
    content = {**(_read(path / RUN) or {}), **more}
    with atomic_file(path / RUN) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def files_of_run(path: Path) -> list[str]:
    """Return the names of the files that ``run.json`` says were made, none if there is no such file."""
    earlier = _read(path / RUN) or {}
    return [name for name in earlier.get("files", []) if isinstance(name, str)]


def remove_files(path: Path, names: Iterable[str]) -> None:
    """Delete files of an output folder, and folders left empty; names that lead out of it are left alone."""
    for name in names:
        file = path / name
        if path.resolve() not in file.resolve().parents:
            continue
        if file.is_dir():
            shutil.rmtree(file, ignore_errors=True)
        else:
            file.unlink(missing_ok=True)
        if file.parent != path:
            with suppress(OSError):  # others are in it
                file.parent.rmdir()


def put_in_place(result: Path, path: Path) -> None:
    """Move a result's files to a folder of the same disk, in place of its files; ``run.json`` comes last."""
    names = files_of_run(result)
    with usable(path):
        remove_files(path, set(files_of_run(path)) - set(names))
        for name in sorted(names, key=lambda one: one == RUN):
            target = path / name
            if target.is_dir():
                shutil.rmtree(target)
            target.parent.mkdir(parents=True, exist_ok=True)
            (result / name).replace(target)


def _clear(path: Path) -> None:
    of_buildings = [name for files in FORMAT_FILES.values() for name in files]
    remove_files(
        path, (RUN, REPORT_FILE, DTM, DSM, NDSM, DTM_VARIANCE, BLOCKS, *of_buildings, *files_of_run(path))
    )
    for one in (path / PARTIAL).glob("*"):
        if one.name not in _NOT_OF_RUN:
            one.unlink(missing_ok=True)


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None


@contextmanager
def usable(path: Path) -> Iterator[None]:
    """Turn what fails in making or writing an output folder into one OutputError."""
    try:
        yield
    except OSError as error:
        reason = one_line(error)
        raise OutputError(
            f"{path}: cannot be used for output ({reason}): choose another folder, or check its permissions"
        ) from error


#: Folders that this process has: locks of POSIX do not keep a process from itself.
_mine: set[Path] = set()


@contextmanager
def sole_use(path: Path) -> Iterator[None]:
    """
    Lock a folder against the runs of other processes; it is made if it is not there.

    The kernel releases the lock when the process ends, and forked processes do not have it. Nothing is locked
    where the file system has no locks, and a part of this process may take the folder again. OutputError if
    another process has it, or it cannot be made.
    """
    folder = Path(os.path.realpath(path))  # which says nothing of links in a circle
    if folder in _mine:
        yield
        return
    was_there = folder.exists()
    with usable(path):
        (folder / PARTIAL).mkdir(parents=True, exist_ok=True)
        try:
            descriptor = _locked(folder / PARTIAL / LOCK)
        except BlockingIOError as error:
            raise OutputError(
                f"{path}: in use by another run: wait for it to end, or choose another folder"
            ) from error
    _mine.add(folder)
    try:
        yield
    finally:
        _mine.discard(folder)
        with suppress(OSError):  # what holds something else stays
            (folder / PARTIAL / LOCK).unlink(missing_ok=True)
            os.close(descriptor)
            (folder / PARTIAL).rmdir()
            if not was_there:
                folder.rmdir()


def _locked(path: Path) -> int:
    """Open a file and lock it; one that its last owner deleted meanwhile is none."""
    import fcntl  # not there on Windows

    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            raise
        except OSError:  # a file system without locks
            return descriptor
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                return descriptor
        os.close(descriptor)
