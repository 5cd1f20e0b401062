"""Choice of the compiled kernels that this process uses.

- *Objects*: compiled ahead of time, in the extension ``_kernels``, for an instruction set of this processor.
   This is the usual case.
- *JIT*: compiled by numba at the first call, on processors without objects and after editing kernels.
- *Interpreted*: plain Python, for stepping through (``NUMBA_DISABLE_JIT=1``).

``PROXIMITY_ISA`` overrides the choice with the name of an instruction set (``v3``, ``v4``, ``neon``) or
``jit``.
"""

import importlib.util
import os
import sys
from typing import Any

from proximity.native.sources import TOOLS, sources_digest

JIT, INTERPRETED = "jit", "interpreted"
_REBUILD = "run `python -m pip install -e .` in the checkout"


def extension() -> Any:
    """Return the extension module, or None if there is none."""
    try:
        from proximity.native import _kernels  # type: ignore[attr-defined]
    except ImportError:
        return None
    return _kernels


def _mode() -> tuple[str, Any]:
    """Return the mode or the name of an instruction set. Return also the extension if it is used."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return INTERPRETED, None
    wanted = os.environ.get("PROXIMITY_ISA", "")
    if wanted == JIT:
        return JIT, None
    objects = extension()
    usable = objects.usable_instructions() if objects else []
    if wanted:
        if wanted not in usable:
            raise ImportError(
                f"PROXIMITY_ISA is {wanted!r}, expected 'jit' or one of {usable}, which this processor has "
                "and kernels were compiled for"
            )
        return wanted, objects
    if not objects:
        return _instead("kernels have not been compiled for this system")
    if TOOLS.is_dir() and objects.sources_digest != sources_digest():
        return _instead("kernels have been edited since they were compiled")
    if not usable:
        return _instead("this processor has none of the instructions that kernels were compiled for")
    return usable[-1], objects


def _instead(reason: str) -> tuple[str, Any]:
    """Fall back to numba, and print the reason."""
    if importlib.util.find_spec("numba") is None:
        raise ImportError(
            f"proximity: {reason}, and numba, which compiles them when they are called, is not installed: "
            f'{_REBUILD}, or install numba: `python -m pip install "cad-proximity[jit]"`'
        )
    if sys.stderr is not None:
        print(
            f"proximity: {reason}; numba compiles them when they are first called, which takes a minute or "
            f"two once ({_REBUILD} to compile them ahead of time)",
            file=sys.stderr,
        )
    return JIT, None


MODE, OBJECTS = _mode()
IS_AHEAD = OBJECTS is not None
"""Whether kernels were compiled ahead of time."""
IS_JIT = MODE == JIT
"""Whether numba compiles the kernels."""
