"""The chunk table of a LAZ file: what it claims is checked before memory is taken for it."""

from __future__ import annotations

import struct
from pathlib import Path

from lidar_buildings.core.model.errors import InputError

#: Where a LAS header says how its points are stored, and where they begin (LAS 1.4, table 3).
_FORMAT, _OFFSET = 104, 96
_COMPRESSED = 0x80
#: A chunk begins with a point as it is, of 20 bytes at least.
_SMALLEST_CHUNK = 20


def check_chunks(path: Path) -> None:
    """
    Refuse a LAZ file that claims more chunks than it has room for.

    lazrs takes memory for as many as the file says, and ends the process where there is not so much.

    Raises
    ------
    InputError
        If the number of chunks cannot be true.
    OSError
        If the file cannot be read.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(_FORMAT + 1)
        if len(header) <= _FORMAT or not header[_FORMAT] & _COMPRESSED:
            return
        (start,) = struct.unpack_from("<I", header, _OFFSET)
        file.seek(start)
        at = _number(file.read(8), "<q")
        if at == -1 and size >= 8:  # written at the end where the writer could not go back
            file.seek(size - 8)
            at = _number(file.read(8), "<q")
        if not 0 <= at <= size - 8:
            return
        file.seek(at + 4)
        n_chunks = _number(file.read(4), "<I")
    if n_chunks * _SMALLEST_CHUNK > size:
        raise InputError(
            f"{path}: is damaged: claims {n_chunks} chunks of points in {size} bytes: download it again"
        )


def _number(content: bytes, kind: str) -> int:
    """Return a number of the file, -1 if it ends before."""
    return int(struct.unpack(kind, content)[0]) if len(content) == struct.calcsize(kind) else -1
