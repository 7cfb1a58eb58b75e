"""
Which counting of references a compiled loop can do without.

Numba counts a reference for each name that an array has, and those of parts of it, with instructions that
wait for the other cores. Its own look at what cancels out (`LLVM_REFPRUNE_PASS`) gives up where a loop has
several ways out or an array several names: two of three counts stay, some in the innermost loops.
"""

from __future__ import annotations

import re

_FUNCTION = re.compile(r"^define .*?^}$", re.MULTILINE | re.DOTALL)
_COUNT = re.compile(r" +(?:tail )?call void @NRT_(?:inc|dec)ref\(ptr (%[^ ,()]+)\)")
#: One pointer out of several, and the block that each of them comes from.
_CHOICE = re.compile(r" +(%[^ ]+) = (?:phi ptr|select i1 [^,]+, ptr) (.*)")
_BLOCK = re.compile(r", %[^ ]+ \]")
_NAME = re.compile(r"%[^ ,()]+")
#: How numba names what a function is handed, as its variables may be named, too.
_ARGUMENT = re.compile(r"%arg\.[^ ,()]+")


def without_borrowed(module: str) -> str:
    """
    Leave out the counting of references to arrays that were handed in: whoever calls holds them.

    Each function gives back as many references to them as it takes, so that all of its counts can go, or none
    may: they stay for an array that goes into what is returned or kept, or whose name may stand for one that
    the function made.

    `module` is LLVM's code of numba's functions, with pointers as plain values (after SROA and InstCombine).
    """
    return _FUNCTION.sub(lambda function: _without_borrowed(function[0]), module)


def _without_borrowed(function: str) -> str:
    lines = [(line, _COUNT.match(line)) for line in function.split("\n")]
    counted = {count[1] for _, count in lines if count}
    if not counted:
        return function
    handed_in = set(_ARGUMENT.findall(lines[0][0]))
    owned = _owned(counted, handed_in, [line for line, count in lines[1:] if not count])
    return "\n".join(line for line, count in lines if not count or count[1] in owned)


def _owned(pointers: set[str], handed_in: set[str], lines: list[str]) -> set[str]:
    """Return those that may be the function's own, or be part of what it makes; with what they stand for."""
    choices: dict[str, set[str]] = {}
    owned: set[str] = set()
    for line in lines:
        choice = _CHOICE.match(line)
        if choice:
            choices[choice[1]] = {choice[1], *_NAME.findall(_BLOCK.sub("", choice[2]))}
        elif " call " not in line:  # who is called borrows in turn
            owned.update(_NAME.findall(line))
    owned |= pointers.union(*choices.values()) - choices.keys() - handed_in
    n_before = -1
    while n_before != len(owned):
        n_before = len(owned)
        owned.update(*(names for names in choices.values() if not owned.isdisjoint(names)))
    return owned
