"""Functions of the extension that are written in C: the same ones however kernels are compiled."""

from typing import Any

from proximity.native.declaration import codes
from proximity.native.mode import extension
from proximity.native.signature import signature
from proximity.native.sources import TOOLS, digest_in_c

C_CODE = "c"
"""Stands where a wrapper's set of instructions stands."""


def function_in_c(name: str, types: str) -> Any:
    """Return a function of the extension; `ImportError` where that is missing or of other sources."""
    compiled = extension()
    if compiled is None:
        raise ImportError("there is no compiled extension for this system")
    if TOOLS.is_dir() and compiled.digest_in_c != digest_in_c():
        raise ImportError("its sources were edited since it was compiled")
    declared = signature(types)
    takes, gives = (tuple(map(codes, each)) for each in (declared.arguments, declared.results))
    return compiled.make_entry(C_CODE, name, takes, gives, -1)
