"""Entry points by their names, for Python: ``from proximity.kernels.entries import signed_batch``.

Compiled ones are made from the table of the extension, so that no module of kernels is imported for them.
Otherwise the module that declares one is imported. A signature may name what `layout` declares, no other
record or bundle.
"""

from typing import Any

from proximity.kernels import layout as layout
from proximity.native import entry_named


def __getattr__(name: str) -> Any:
    """Return the entry point of a name, and keep it."""
    value = entry_named(name)
    globals()[name] = value
    return value
