"""The receiver of ``proximity_message.h`` as the extension has it: functions of arrays of bytes."""

from functools import cache
from typing import Any

from proximity.errors import ArgumentError
from proximity.native.in_c import function_in_c

_SIGNATURES = {
    "is_old": "uint8[:], uint8[:], int, int, int -> bool",
    "accept": "uint8[:], uint8[:], int, int, int",
    "content_flaw": "uint8[:], int -> int",
    "widen": "uint8[:], int, float, float",
    "forget": "uint8[:]",
}


@cache
def receiver_in_c(name: str) -> Any:
    """Return a function of the receiver; `ArgumentError` where it was not compiled, or of other sources."""
    try:
        return function_in_c(f"receiver_{name}", _SIGNATURES[name])
    except ImportError as reason:
        raise ArgumentError(
            f"messages cannot be received, which is written in C: {reason}; compile it by "
            "`python tools/build_kernels.py` in the checkout, or install the package anew"
        ) from None
