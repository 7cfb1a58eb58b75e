"""Attributes as a property table of glTF (EXT_structural_metadata)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

#: Type of an attribute → what the schema says of it, and how its numbers are stored. No 64-bit integers:
#: CesiumJS does not know their `noData`.
_NUMBERS: dict[type, tuple[dict[str, Any], str]] = {
    int: ({"type": "SCALAR", "componentType": "UINT32", "noData": 2**32 - 1}, "<u4"),
    float: ({"type": "SCALAR", "componentType": "FLOAT64", "noData": -9999.0}, "<f8"),
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
    Return a table; what a row lacks and None are `noData` or empty texts, and a column of these is left out.

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
            known, dtype = _NUMBERS[kind]
            numbers = [known["noData"] if value is None else value for value in values]
            properties[field] = {"values": add(np.array(numbers, dtype=dtype).tobytes())}
    return {"class": name, "count": len(rows), "properties": properties}


def _texts(values: Sequence[str], add: Callable[[bytes], int]) -> dict[str, int]:
    encoded = [value.encode() for value in values]
    ends = np.cumsum([0, *map(len, encoded)]).astype("<u4")
    return {"values": add(b"".join(encoded)), "stringOffsets": add(ends.tobytes())}
