"""Where inputs are: paths here, or URLs of object stores and web servers, which fsspec reads by ranges."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, BinaryIO, cast
from zlib import crc32

from lidar_buildings.core.model.errors import InputError

#: Bytes that are asked for at once: some chunks of LAZ; a COPC file is read here and there.
_BLOCK = 1 << 16
#: What a store says of a file's state, as one or another of them calls it.
_STATES = ("ETag", "etag", "md5Hash", "Last-Modified", "LastModified", "mtime", "created")


def is_url(path: str | os.PathLike[str]) -> bool:
    """Whether something is the URL of a file elsewhere, such as ``s3://bucket/tile.copc.laz``."""
    return "://" in str(path) and not isinstance(path, Path)


def located(path: str | os.PathLike[str]) -> Path:
    """
    Return the path of a file or folder; of a URL what acts as one for all that inputs are asked.

    InputError if what reads URLs, or those of this kind, is not installed.
    """
    if not is_url(path):
        return Path(path)
    try:
        from upath import UPath  # an extra

        there = UPath(path)
        if there.protocol in ("", "file", "local"):
            return Path(there.path)
        _ = there.fs  # imports what reads this kind of URL
        return cast(Path, there)
    except ImportError as error:
        why = "" if error.name == "upath" else f", and what reads such ones ({error})"
        raise InputError(
            f"{path}: URLs need the extra [cloud]{why}: pip install '.[cloud]' in the sources"
        ) from error
    except ValueError as error:
        raise InputError(f"{path}: {error}: give a URL that fsspec knows, or download it") from error


def open_binary(path: Path) -> BinaryIO:
    """Open a file, wherever it is, to be read at any place."""
    if isinstance(path, Path):
        return open(path, "rb")
    return cast(BinaryIO, cast(Any, path).open("rb", block_size=_BLOCK, cache_type="readahead"))


def state_of(path: Path) -> tuple[int, int]:
    """Return a file's size [bytes] and when it was last changed [ns]; elsewhere a number for that."""
    if isinstance(path, Path):
        found = path.stat()
        return found.st_size, found.st_mtime_ns
    store = cast(Any, path).fs
    store.invalidate_cache()
    told = store.info(cast(Any, path).path)
    if told.get("size") is None:
        raise InputError(f"{path}: its server does not report its size: download it")
    state = next((told[name] for name in _STATES if told.get(name)), "")
    return int(told["size"]), crc32(str(state).encode())
