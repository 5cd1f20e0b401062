"""Declaration of kernels, independent of how they are compiled.

Python calls only entry points. All other compiled functions are called by compiled code. If such a function
was compiled ahead of time, calling it from Python is an error, so that no kernel runs as slow Python by
accident.
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
"""All entry points by name that modules of this process have declared."""
ROWS_WITH_GIL = 16
"""Maximum number of rows for which an entry point may keep the interpreter locked.

Releasing it takes 0.1 µs.
"""
_KINDS = {"int": 0, "float": 1, "bool": 2}
_ARRAY, _BUNDLE = 3, 4
C_CODE = "c"
"""Marks a wrapper of a function written in C. Other wrappers have the name of an instruction set there."""
_RECORD_SIZE = 256
"""Factor of the item size in the type number of a record. NumPy gives all records the same number."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A kernel that Python calls."""

    name: str
    signature: Signature
    rows_with_gil: int  # rows up to which the interpreter stays locked
    compiled: Any  # the function compiled by numba, or the plain one

    def description(self) -> tuple[Any, ...]:
        """Return the description of the entry point for the extension."""
        takes, gives = (
            tuple(map(codes, each)) for each in (self.signature.arguments, self.signature.results)
        )
        return MODE, self.name, takes, gives, self.rows_with_gil


def entry(
    *parts: Any, rows_with_gil: int = -1, makes_arrays: bool = False
) -> Callable[[Callable[..., Any]], Any]:
    """Declare a kernel that Python calls, with the types of its arguments and results.

    Arguments of other types raise an error. *parts*: the signature, see `native.signature`. *rows_with_gil*:
    largest number of rows of the first array for which the interpreter stays locked during a call, or -1 for
    never. *makes_arrays*: whether it allocates arrays. Other kernels count no references.
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
    """Return an entry point from the compiled table. Without one, import the module that declares it."""
    if name.startswith("__"):  # Python probes every module for such names
        raise AttributeError(name)
    if not IS_AHEAD:
        import_entries(name)
    try:
        found = _entry(name)
    except KeyError:
        raise AttributeError(f"there is no entry point {name!r}") from None
    return OBJECTS.make_entry(*found.description()) if IS_AHEAD else found.compiled


def import_entries(name: str = "") -> None:
    """Import the kernel modules that declare entry points.

    With *name*, import only the modules that define it.
    """
    for module in entry_modules(name):
        import_module(module)


def _entry(name: str) -> Entry:
    """Return the declaration of an entry point, from the extension or from a module."""
    if not IS_AHEAD:
        return ENTRIES[name]
    rows_with_gil, types = _compiled_table()[name]
    return Entry(name, signature(types), int(rows_with_gil), None)


@cache
def _compiled_table() -> dict[str, list[str]]:
    """Return the number of rows with the interpreter locked, and the signature, of each entry point."""
    lines = (line.split("|") for line in OBJECTS.entry_signatures.splitlines())
    return {name: values for name, *values in lines}


def kernel(function: Callable[..., Any]) -> Any:
    """Declare a function of compiled code.

    It allocates no arrays and counts no references, which would take a fifth of a tick. Its scratch memory is
    on the stack, see `kernels.stack_arrays`. LLVM decides whether to inline it.
    """
    return _compiled(function, _nrt=False)


def allocating_kernel(function: Callable[..., Any]) -> Any:
    """Declare a function of compiled code that allocates arrays."""
    return _compiled(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Mark a kernel as always inlined."""
    return _compiled(function, forceinline=True, _nrt=False)


def query(name: str, width: int, few: int, ask: Callable[..., Any]) -> Any:
    """Return the Python function of a query.

    The function takes a model, arrays of rows, a limit and a number of workers, and returns the table of
    answers. If possible, compiled code handles small batches of plain rows directly, which saves half a
    microsecond in a call with five rows. *ask* validates and answers all other calls, and raises errors.

    The entry point *name* takes a bundle, the arrays of rows, their order, limits, and answers with *width*
    columns. It returns -1 if it has answered all rows. It is called directly for fewer than *few* rows.
    """
    if not IS_AHEAD:
        return ask
    declared = _entry(name)
    arguments = declared.signature.arguments
    dtype = np.dtype(arguments[-1].dtype).num  # type: ignore[union-attr]
    return OBJECTS.make_query(declared.description(), len(arguments) - 4, width, dtype, few, ask)


def packed(arrays: Any) -> Any:
    """Return a bundle in the form that entry points take, without a copy. `bundle` has declared its class."""
    if not IS_AHEAD:
        return arrays
    kind = BUNDLES[type(arrays).__name__]
    words = tuple(map(codes, kind.arrays))
    return OBJECTS.make_bundle(kind.name, list(BUNDLES).index(kind.name), words, tuple(arrays))


def function_in_c(name: str, types: str) -> Any:
    """Return a function written in C. Raise an `ImportError` if the extension is missing or out of date."""
    compiled = extension()
    if compiled is None:
        raise ImportError("there is no compiled extension for this system")
    if TOOLS.is_dir() and compiled.digest_in_c != digest_in_c():
        raise ImportError("its sources were edited since it was compiled")
    declared = signature(types)
    takes, gives = (tuple(map(codes, each)) for each in (declared.arguments, declared.results))
    return compiled.make_entry(C_CODE, name, takes, gives, -1)


class _Internal:
    """Placeholder for a compiled function that Python cannot call."""

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
    """Return the three numbers by which the extension knows a type, and the lengths of an array's axes."""
    if isinstance(value, Scalar):
        return _KINDS[value.kind], 0, 0
    if isinstance(value, Bundle):
        return _BUNDLE, list(BUNDLES).index(value.name), 0
    dtype = dtype_of(value.dtype)
    number = dtype.num + (_RECORD_SIZE * dtype.itemsize if dtype.names else 0)
    return _ARRAY, number, 0, *value.lengths
