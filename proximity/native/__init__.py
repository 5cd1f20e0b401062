"""Compiled kernels: how they are declared, and where their code comes from."""

from proximity.native.declaration import (
    ENTRIES,
    HANDFUL,
    entry,
    inlined,
    kernel,
    lenient,
    maker,
    packed,
    query,
)
from proximity.native.mode import IS_AHEAD, IS_JIT, MODE
from proximity.native.signature import bundle, record

__all__ = [
    "ENTRIES",
    "HANDFUL",
    "IS_AHEAD",
    "IS_JIT",
    "MODE",
    "bundle",
    "entry",
    "inlined",
    "kernel",
    "lenient",
    "maker",
    "packed",
    "query",
    "record",
]
