"""Convert untrusted text to a cell of a table that a spreadsheet may open."""

import re
from typing import Any

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")
_BEGIN_FORMULAS = ("=", "+", "-", "@")


def table_text(value: Any) -> Any:
    """Return text without control characters. An apostrophe is prepended if it begins like a formula.

    Other values are returned unchanged.
    """
    if not isinstance(value, str):
        return value
    text = _CONTROL.sub("?", value)
    return f"'{text}" if text.startswith(_BEGIN_FORMULAS) else text
