"""Words for kinds of roofs: which of a result stand for which of a reference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: Roof type of a reference → the types of a result that mean the same, or the same of its largest part.
_ALSO: dict[str, set[str]] = {
    "hip": {"pyramid"},
    "l": {"l-shape"},
    "t": {"t-shape"},
    "l-shape": {"l"},
    "t-shape": {"t"},
    "hipped-l": {"l", "l-shape", "complex"},
    "cross-gable": {"complex", "t", "t-shape"},
    "round-tower": {"pyramid", "complex"},
    "dormer": {"gable"},
    "gable-dormer": {"gable"},
    "church": {"gable"},
    "parapet": {"flat"},
    "step": {"flat"},
}
#: Shapes that have no word of their own in results.
_COMPLEX = {
    *("barrel", "church", "courtyard", "dormer", "double-gable", "gable-dormer", "gambrel", "mansard"),
    *("parapet", "sawtooth", "step"),
}


def same_roof_type(found: str, true: Mapping[str, Any]) -> bool:
    """
    Whether a result's word for a roof says what the reference says.

    Parameters
    ----------
    found : str
    true : mapping
        The reference's attributes: `roof_type`, and `n_planes` where it is known: whatever the outline's
        shape, one level plane is a flat roof.
    """
    mine, theirs = _plain(found), _plain(str(true["roof_type"]))
    types = {theirs} | _ALSO.get(theirs, set())
    if theirs in _COMPLEX:
        types.add("complex")
    if true.get("n_planes") == 1 and theirs != "shed":
        types = {"flat", theirs}
    return mine in types


def _plain(word: str) -> str:
    """Return a word in small letters with hyphens."""
    return word.strip().lower().replace("_", "-").replace(" ", "-")
