"""Attributes as a property table of glTF (EXT_structural_metadata)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

#: Stands for numbers that are not known.
NO_DATA = -9999
#: Type of an attribute → what the schema says of it, and how its numbers are stored.
_NUMBERS: dict[type, tuple[dict[str, Any], str]] = {
    int: ({"type": "SCALAR", "componentType": "INT64", "noData": NO_DATA}, "<i8"),
    float: ({"type": "SCALAR", "componentType": "FLOAT64", "noData": float(NO_DATA)}, "<f8"),
}
_TEXT = {"type": "STRING", "noData": ""}


def schema(name: str, fields: Mapping[str, type]) -> dict[str, Any]:
    """
    Return the schema of a table.

    Parameters
    ----------
    name : str
        Of the one class.
    fields : mapping
        Attribute → int, float or str.
    """
    properties = {field: dict(_TEXT if kind is str else _NUMBERS[kind][0]) for field, kind in fields.items()}
    return {"id": f"{name}s", "classes": {name: {"properties": properties}}}


def property_table(
    name: str,
    fields: Mapping[str, type],
    rows: Sequence[Mapping[str, Any]],
    add: Callable[[bytes], int],
) -> dict[str, Any]:
    """
    Return a table; what a row lacks and None are `NO_DATA` or empty texts, and a column of these is left out.

    Parameters
    ----------
    name : str
        Its class.
    fields : mapping
        Attribute → int, float or str.
    rows : sequence of mapping
        Attribute → value.
    add : callable
        Stores bytes and returns the number of their view.
    """
    properties = {}
    for field, kind in fields.items():
        values = [row.get(field) for row in rows]
        if kind is str:
            texts = ["" if value is None else str(value) for value in values]
            if any(texts):  # a view has at least one byte, and is as long as its texts
                properties[field] = _texts(texts, add)
        else:
            known = [NO_DATA if value is None else value for value in values]
            properties[field] = {"values": add(np.array(known, dtype=_NUMBERS[kind][1]).tobytes())}
    return {"class": name, "count": len(rows), "properties": properties}


def _texts(values: Sequence[str], add: Callable[[bytes], int]) -> dict[str, int]:
    encoded = [value.encode() for value in values]
    ends = np.cumsum([0, *map(len, encoded)]).astype("<u4")
    return {"values": add(b"".join(encoded)), "stringOffsets": add(ends.tobytes())}
