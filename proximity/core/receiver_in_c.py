"""The receiver of ``proximity_message.h`` as the extension has it: functions of arrays of bytes."""

from functools import cache
from typing import Any

from proximity.native.declaration import function_in_c
from proximity.system.extras import needed_in_c

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
    with needed_in_c("messages cannot be received, which is written in C"):
        return function_in_c(f"receiver_{name}", _SIGNATURES[name])
