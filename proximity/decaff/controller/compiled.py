"""The controller in C, as it is compiled into the package: its structures as NumPy types, and its functions.

``decaff_controller.h`` is the one description of the structures; here it is read.
"""

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import ArgumentError
from proximity.message import CONTACT, VERSION
from proximity.native.in_c import function_in_c

SOURCE, HEADER = (Path(__file__).with_name(f"decaff_controller.{ending}") for ending in "ch")
_NUMBERS = {"bool": "?", "uint8_t": "u1", "uint32_t": "u4", "size_t": "u8", "int64_t": "i8", "uint64_t": "u8"}
_NUMBERS |= {"double": "f8", "decaff_real": "f8"}
_STRUCTURE = re.compile(r"typedef struct (\w+) \{\n(.*?)\} \1;", re.DOTALL)
_FIELD = re.compile(r"(?m)^    (?:const )?((?:enum )?\w+) (\*?)(\w+)(?:\[(\w+)\])?;")
_LENGTH = re.compile(r"#define (\w+) (\d+)u")


def _structures() -> dict[str, np.dtype]:
    """Structures of the header by their names, but those of messages."""
    text = HEADER.read_text(encoding="ascii")
    lengths = {name: int(number) for name, number in _LENGTH.findall(text)}
    kinds: dict[str, Any] = dict(_NUMBERS)
    for name, body in _STRUCTURE.findall(text):
        fields = []
        for kind, pointer, field, length in _FIELD.findall(body):
            number = "u8" if pointer else "i4" if kind.startswith("enum ") else kinds.get(kind)
            fields.append((field, number, (lengths[length],)) if length in lengths else (field, number))
        if all(field[1] is not None for field in fields):  # else it holds messages, as a subscriber does
            kinds[name] = np.dtype(fields, align=True)
    return kinds


_KINDS = _structures()
SETTINGS, PATH, CONTROLLER, OBSERVATION, ACTION, STEADY, SERVO = (
    _KINDS[f"decaff_{name}"]
    for name in ("settings", "path", "controller", "observation", "action", "steady", "servo")
)
MOST_STEADY = int(dict(_LENGTH.findall(HEADER.read_text(encoding="ascii")))["DECAFF_MOST_STEADY"])
_SIGNATURES = {
    "begin": "uint8[:], uint8[:]",
    "reset": "uint8[:]",
    "step": "uint8[:, :], uint8[:, :], uint8[:, :]",
    "servo_begin": "uint8[:], uint8[:], float",
    "servo_step": "uint8[:], uint8[:], float, float -> float",
    "is_steady": "uint8[:], uint8[:], float, float -> bool",
    "displayed": "uint8[:], float, float -> float, float",
}


@cache
def in_c(name: str) -> Any:
    """Return a function of the controller, of bytes of these structures."""
    try:
        sizes = np.zeros(9, np.int64)
        function_in_c("controller_sizes", "int64[9]")(sizes)
        if sizes.tolist() != [
            *(kind.itemsize for kind in (SETTINGS, PATH, CONTROLLER, OBSERVATION, ACTION, STEADY, CONTACT)),
            VERSION,
            SERVO.itemsize,
        ]:
            raise ImportError("its structures are others than those of the compiled controller")
        return function_in_c(f"controller_{name}", _SIGNATURES[name])
    except ImportError as reason:
        raise ArgumentError(
            f"the drum's controller, which is written in C, cannot run: {reason}; compile it by "
            "`python tools/build_kernels.py` in the checkout, or install the package anew"
        ) from None


def memory(kind: np.dtype) -> tuple[np.ndarray, Any, np.ndarray]:
    """Return a zeroed structure: an array of one, its record, and a row of its bytes."""
    array = np.zeros(1, kind)
    return array, array.view(np.recarray)[0], array.view(np.uint8).reshape(1, kind.itemsize)
