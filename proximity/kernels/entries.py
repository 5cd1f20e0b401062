"""Entry points by name, for Python: ``from proximity.kernels.entries import signed_batch``.

Compiled entry points come from the table of the extension, without importing kernel modules. Otherwise the
module that declares the entry point is imported. A signature may name only records and bundles of `layout`.
"""

from typing import Any

from proximity.kernels import layout as layout
from proximity.native import entry_named


def __getattr__(name: str) -> Any:
    """Return the entry point of that name, and cache it."""
    value = entry_named(name)
    globals()[name] = value
    return value
