"""
How objects travel between processes: pickled, their large arrays in memory that all of them see.

An array is copied there once. From then on processes hand each other file descriptors, and an array that
comes back, or goes on to the next process, is not copied again. So what a process is given it must not change
in place and return: that would come back as it was.
"""

from __future__ import annotations

import mmap
import os
import pickle
import socket
import tempfile
import weakref
from collections.abc import Sequence
from itertools import count
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

#: Arrays from this size on go beside the pickle [bytes].
_LARGE = 65_536
#: Arrays begin at multiples of this [bytes].
_ALIGNMENT = 64
#: Descriptors in one message at most, as of Linux.
_MAX_DESCRIPTORS = 253

_numbers = count()


class Memory(mmap.mmap):
    """
    Memory that other processes see, too, as long as an array lies in it.

    What is written to such an array later is seen in the process alone that writes.
    """

    name: str
    descriptor: int
    address: int

    def __new__(cls, name: str, descriptor: int) -> Memory:
        self = super().__new__(cls, descriptor, 0, flags=mmap.MAP_PRIVATE)
        self.name, self.descriptor = name, descriptor
        self.address = np.frombuffer(self, np.uint8).ctypes.data
        weakref.finalize(self, os.close, descriptor)
        _memories[name] = self
        return self

    @classmethod
    def of(cls, name: str, descriptor: int) -> Memory:
        """Return memory of another process, mapped once."""
        memory = _memories.get(name)
        if memory is None:
            return cls(name, descriptor)
        os.close(descriptor)
        return memory


#: What this process sees, by name.
_memories: weakref.WeakValueDictionary[str, Memory] = weakref.WeakValueDictionary()


class Place(NamedTuple):
    """Where an array lies: in which memory, from which byte on, and how many."""

    memory: Memory
    begin: int
    size: int


class Parcel(NamedTuple):
    """Something that is packed."""

    pickled: bytes  #: all but its large arrays
    large: Sequence[Place] = ()  #: these, in the pickle's order


def packed(content: object) -> Parcel:
    """Pack something to be sent."""
    large: list[memoryview] = []

    def is_small(buffer: pickle.PickleBuffer) -> bool:
        raw = buffer.raw()
        if raw.nbytes >= _LARGE:
            large.append(raw)
        return raw.nbytes < _LARGE

    pickled = pickle.dumps(content, protocol=5, buffer_callback=is_small)
    there = [_place_of(one) for one in large]
    copies = iter(_copied([one for one, place in zip(large, there, strict=True) if place is None]))
    return Parcel(pickled, [place or next(copies) for place in there])


def unpacked(parcel: Parcel) -> Any:
    """Return what is in a parcel; its arrays are those that came."""
    large = [memoryview(memory)[begin : begin + size] for memory, begin, size in parcel.large]
    return pickle.loads(parcel.pickled, buffers=large)


def send(link: Connection, parcel: Parcel) -> None:
    """Send a parcel to another process."""
    memories = list({place.memory.name: place.memory for place in parcel.large}.values())
    names = [one.name for one in memories]
    places = [(names.index(memory.name), begin, size) for memory, begin, size in parcel.large]
    link.send((parcel.pickled, names, places))
    with _channel(link) as channel:
        for first in range(0, len(memories), _MAX_DESCRIPTORS):
            some = memories[first : first + _MAX_DESCRIPTORS]
            socket.send_fds(channel, [b"."], [one.descriptor for one in some])


def receive(link: Connection) -> Parcel:
    """Take the parcel that comes next."""
    pickled, names, places = link.recv()
    descriptors: list[int] = []
    with _channel(link) as channel:
        while len(descriptors) < len(names):
            some = socket.recv_fds(channel, 1, _MAX_DESCRIPTORS)[1]
            if not some:
                raise EOFError
            descriptors += some
    memories = [Memory.of(*one) for one in zip(names, descriptors, strict=True)]
    return Parcel(pickled, [Place(memories[number], begin, size) for number, begin, size in places])


def _channel(link: Connection) -> socket.socket:
    """Return the link as what descriptors can be sent through."""
    return socket.socket(fileno=os.dup(link.fileno()))


def _place_of(array: memoryview) -> Place | None:
    """Return where an array lies, None if in no memory that others see."""
    holder: Any = array
    while holder is not None and not isinstance(holder, Memory):
        holder = holder.obj if isinstance(holder, memoryview) else getattr(holder, "base", None)
    if holder is None:
        return None
    return Place(holder, np.frombuffer(array, np.uint8).ctypes.data - holder.address, array.nbytes)


def _copied(arrays: Sequence[memoryview]) -> list[Place]:
    """Copy arrays to new memory, one after the other."""
    if not arrays:
        return []
    with _file() as file:
        begins = []
        for array in arrays:
            file.seek(-file.tell() % _ALIGNMENT, os.SEEK_CUR)
            begins.append(file.tell())
            file.write(array)
        file.flush()
        memory = Memory(f"{os.getpid()}.{next(_numbers)}", os.dup(file.fileno()))
    return [Place(memory, begin, array.nbytes) for begin, array in zip(begins, arrays, strict=True)]


def _file() -> Any:
    """Return an empty file without a name, in memory where the platform has such."""
    if not hasattr(os, "memfd_create"):
        return tempfile.TemporaryFile()
    return os.fdopen(os.memfd_create("lidar_buildings"), "w+b")
