"""JSON for machines: on one line, without spaces, the same for the same content."""

from __future__ import annotations

import json
from typing import Any


def compact_json(content: Any) -> str:
    """Return content as JSON; only finite numbers are let through."""
    return json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
