"""What processes hand each other: pickles, and beside them their large arrays, which are not copied."""

from __future__ import annotations

import os
import pickle
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

#: Arrays from this size on go beside the pickle [bytes].
_LARGE = 65_536


class Parcel(NamedTuple):
    """
    Something that is packed.

    Attributes
    ----------
    pickled : bytes
        All but its large arrays.
    large : sequence of buffers
        These, in the pickle's order; not copied, so nothing may write to them meanwhile.
    """

    pickled: bytes
    large: Sequence[Any] = ()


def packed(content: object) -> Parcel:
    """Pack something that is sent at once."""
    large: list[memoryview] = []

    def is_small(buffer: pickle.PickleBuffer) -> bool:
        raw = buffer.raw()
        if raw.nbytes >= _LARGE:
            large.append(raw)
        return raw.nbytes < _LARGE

    return Parcel(pickle.dumps(content, protocol=5, buffer_callback=is_small), large)


def unpacked(parcel: Parcel) -> Any:
    """Return what is in a parcel; its arrays are those that came."""
    return pickle.loads(parcel.pickled, buffers=parcel.large)


def send(link: Connection, parcel: Parcel) -> None:
    """Send a parcel to another process."""
    link.send((parcel.pickled, [len(one) for one in parcel.large]))
    for one in parcel.large:
        left = memoryview(one)
        while left:
            left = left[os.write(link.fileno(), left) :]


def receive(link: Connection) -> Parcel:
    """Take the parcel that comes next, straight into the memory of its arrays."""
    pickled, sizes = link.recv()
    large = [np.empty(size, np.uint8) for size in sizes]
    for one in large:
        left = memoryview(one)
        while left:
            n_read = os.readv(link.fileno(), [left])
            if not n_read:
                raise EOFError
            left = left[n_read:]
    return Parcel(pickled, large)
