"""Declaration of compiled kernels, and the choice of their code."""

from proximity.native.declaration import (
    ENTRIES,
    ROWS_WITH_GIL,
    allocating_kernel,
    entry,
    entry_named,
    import_entries,
    inlined,
    kernel,
    packed,
    query,
)
from proximity.native.mode import IS_AHEAD, IS_JIT, MODE
from proximity.native.signature import bundle, record

__all__ = [
    "ENTRIES",
    "IS_AHEAD",
    "IS_JIT",
    "MODE",
    "ROWS_WITH_GIL",
    "allocating_kernel",
    "bundle",
    "entry",
    "entry_named",
    "import_entries",
    "inlined",
    "kernel",
    "packed",
    "query",
    "record",
]
