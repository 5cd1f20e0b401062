"""How kernels are declared, whichever way they are compiled.

Python calls entry points only. Everything else that is compiled is called by compiled code: calling it from
Python is an error where it was compiled ahead of time, so that nothing runs as slow Python by accident.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from proximity.native.mode import IS_AHEAD, IS_JIT, MODE, OBJECTS, extension
from proximity.native.signature import (
    BUNDLES,
    Array,
    Bundle,
    Scalar,
    Signature,
    dtype_of,
    signature,
)
from proximity.native.sources import TOOLS, digest_in_c, entry_modules

ENTRIES: dict[str, "Entry"] = {}
"""All entry points that modules of this process declare, by their names."""
ROWS_WITH_GIL = 16
"""Rows up to which an entry point may keep the interpreter locked: to release it takes 0.1 µs."""
_KINDS = {"int": 0, "float": 1, "bool": 2}
_ARRAY, _BUNDLE = 3, 4
C_CODE = "c"
"""Stands where a wrapper's set of instructions stands."""
_RECORD_SIZE = 256
"""Factor of the size in the number of a type of records, which NumPy gives all the same number."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A kernel that Python calls."""

    name: str
    signature: Signature
    rows_with_gil: int  # rows up to which the interpreter stays locked
    compiled: Any  # the function as numba compiles it, or the plain one

    def description(self) -> tuple[Any, ...]:
        """Return what the extension has to know."""
        takes, gives = (
            tuple(map(codes, each)) for each in (self.signature.arguments, self.signature.results)
        )
        return MODE, self.name, takes, gives, self.rows_with_gil


def entry(
    *parts: Any, rows_with_gil: int = -1, makes_arrays: bool = False
) -> Callable[[Callable[..., Any]], Any]:
    """Declare a kernel that Python calls, with the types that it takes and gives; other types are an error.

    *parts*: the signature, see `native.signature`. *rows_with_gil*: rows of the first array up to which the
    interpreter stays locked during a call; -1: it never does. *makes_arrays*: others count no references.
    """
    types = signature(", ".join(part if isinstance(part, str) else part.__name__ for part in parts))

    def declare(function: Callable[..., Any]) -> Any:
        name = function.__name__
        if name in ENTRIES:
            raise ValueError(f"there are two entry points named {name}")
        compiled = _compiled(function) if makes_arrays else _compiled(function, _nrt=False)
        ENTRIES[name] = Entry(name, types, rows_with_gil, compiled)
        return OBJECTS.make_entry(*ENTRIES[name].description()) if IS_AHEAD else compiled

    return declare


def entry_named(name: str) -> Any:
    """Return an entry point: of the compiled table, or else of the module that declares it."""
    if name.startswith("__"):  # Python looks for such names in every module
        raise AttributeError(name)
    if not IS_AHEAD:
        import_entries(name)
    try:
        found = _entry(name)
    except KeyError:
        raise AttributeError(f"there is no entry point {name!r}") from None
    return OBJECTS.make_entry(*found.description()) if IS_AHEAD else found.compiled


def import_entries(name: str = "") -> None:
    """Import the modules of kernels that declare entry points; with a name, only where that is defined."""
    for module in entry_modules(name):
        import_module(module)


def _entry(name: str) -> Entry:
    """An entry point as the extension has it, or as a module declares it."""
    if not IS_AHEAD:
        return ENTRIES[name]
    rows_with_gil, types = _compiled_table()[name]
    return Entry(name, signature(types), int(rows_with_gil), None)


@cache
def _compiled_table() -> dict[str, list[str]]:
    """Rows with the interpreter locked, and signature, of every entry point that was compiled."""
    lines = (line.split("|") for line in OBJECTS.entry_signatures.splitlines())
    return {name: values for name, *values in lines}


def kernel(function: Callable[..., Any]) -> Any:
    """Declare a function of compiled code.

    It makes no arrays, and so counts no references: they would be a fifth of a tick. What it needs for itself
    is on the stack, see `kernels.stack_arrays`. Whether it is put into its callers is LLVM's to say.
    """
    return _compiled(function, _nrt=False)


def allocating_kernel(function: Callable[..., Any]) -> Any:
    """Declare a function of compiled code that makes arrays."""
    return _compiled(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Mark a kernel as always inlined."""
    return _compiled(function, forceinline=True, _nrt=False)


def query(name: str, width: int, few: int, ask: Callable[..., Any]) -> Any:
    """Return the function of a query: of a model, arrays of rows, a limit, and a number of workers.

    It returns the table of answers. Where it can, compiled code takes few plain rows by itself, which spares
    a call of five rows half a microsecond; all else *ask* checks and answers, and refuses. The entry point
    *name* takes a bundle, the arrays of rows, their order, limits and answers of *width* columns, and returns
    -1 if it has answered all of them; *few*: rows below which it may be asked.
    """
    if not IS_AHEAD:
        return ask
    declared = _entry(name)
    arguments = declared.signature.arguments
    dtype = np.dtype(arguments[-1].dtype).num  # type: ignore[union-attr]
    return OBJECTS.make_query(declared.description(), len(arguments) - 4, width, dtype, few, ask)


def packed(arrays: Any) -> Any:
    """Return a bundle, of a class that `bundle` declared, as entry points take it; nothing is copied."""
    if not IS_AHEAD:
        return arrays
    kind = BUNDLES[type(arrays).__name__]
    words = tuple(map(codes, kind.arrays))
    return OBJECTS.make_bundle(kind.name, list(BUNDLES).index(kind.name), words, tuple(arrays))


def function_in_c(name: str, types: str) -> Any:
    """Return a function written in C; `ImportError` if the extension is missing or of other sources."""
    compiled = extension()
    if compiled is None:
        raise ImportError("there is no compiled extension for this system")
    if TOOLS.is_dir() and compiled.digest_in_c != digest_in_c():
        raise ImportError("its sources were edited since it was compiled")
    declared = signature(types)
    takes, gives = (tuple(map(codes, each)) for each in (declared.arguments, declared.results))
    return compiled.make_entry(C_CODE, name, takes, gives, -1)


class _Internal:
    """What Python cannot call, since it is compiled code's own."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._name = f"{function.__module__}.{function.__qualname__}"

    def __call__(self, *_: Any, **__: Any) -> Any:
        raise TypeError(
            f"{self._name} is called by compiled code only; to call it from Python, have numba compile it "
            "(PROXIMITY_ISA=jit) or step through it (NUMBA_DISABLE_JIT=1)"
        )


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    if IS_AHEAD:
        return _Internal(function)
    if IS_JIT:
        from proximity.native.jit import compiled

        return compiled(function, **{"forceinline": False} | options)
    return function


def codes(value: Array | Scalar | Bundle) -> tuple[int, ...]:
    """How the extension describes a type: kind, number, lengths."""
    if isinstance(value, Scalar):
        return _KINDS[value.kind], 0, 0
    if isinstance(value, Bundle):
        return _BUNDLE, list(BUNDLES).index(value.name), 0
    dtype = dtype_of(value.dtype)
    number = dtype.num + (_RECORD_SIZE * dtype.itemsize if dtype.names else 0)
    return _ARRAY, number, 0, *value.lengths
