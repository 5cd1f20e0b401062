"""Access to the compiled C controller of the package, whose functions take structures as bytes."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from proximity.decaff.controller.records import TYPES
from proximity.message import CONTACT, VERSION
from proximity.native.declaration import function_in_c
from proximity.system.extras import needed_in_c

SOURCE = Path(__file__).with_name("decaff_controller.c")
SETTINGS, PATH, CONTROLLER, OBSERVATION, ACTION, STEADY, SERVO = (
    TYPES[name] for name in ("settings", "path", "controller", "observation", "action", "steady", "servo")
)
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
    """Return a compiled function of the controller by its name. It takes structures as bytes."""
    with needed_in_c("the drum's controller, which is written in C, cannot run"):
        sizes = np.zeros(9, np.int64)
        function_in_c("controller_sizes", "int64[9]")(sizes)
        if sizes.tolist() != [
            *(kind.itemsize for kind in (SETTINGS, PATH, CONTROLLER, OBSERVATION, ACTION, STEADY, CONTACT)),
            VERSION,
            SERVO.itemsize,
        ]:
            raise ImportError("its structures are others than those of the compiled controller")
        return function_in_c(f"controller_{name}", _SIGNATURES[name])


def memory(kind: np.dtype) -> tuple[np.ndarray, Any, np.ndarray]:
    """Return a zeroed structure in three forms, as an array of one, its record, and a row of its bytes."""
    array = np.zeros(1, kind)
    return array, array.view(np.recarray)[0], array.view(np.uint8).reshape(1, kind.itemsize)
