"""JSON for programs; nan and infinity become null, because JSON has no word for them."""

import json
import math
import sys
from typing import Any


def write_document(result: Any, *, indent: int | None = 1) -> None:
    """Write one JSON document to stdout at once: somebody may wait for it."""
    sys.stdout.write(json.dumps(plain(result), allow_nan=False, indent=indent) + "\n")
    sys.stdout.flush()


def plain(value: Any) -> Any:
    """Return *value* with None for every float that JSON has no word for."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value
