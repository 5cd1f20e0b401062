"""Validate numbers and arrays that callers pass to the public interface.

Every error states the expected value. Internal code relies on dtype, shape and order. Lossless conversions
are silent (integers, float32, big-endian, strided and read-only arrays). If a value cannot be converted, the
error gives the reason. Booleans and text are not numbers here; NumPy's scalars are.
"""

import math
import operator
from typing import Any

import numpy as np

from proximity.errors import ArgumentError

FLOAT64 = np.dtype(np.float64)
_ROW = (3,)

READABLE_DEVICES = (1, 3, 11, 13)
"""DLPack device types whose memory the processor can read: CPU, CUDA host, ROCm host, CUDA managed."""
COPIED_AT_ONCE = 1 << 20
"""Number of rows that are copied together, which takes about 10 ms."""
FEW_SHOWN, MAX_SHOWN = 4, 200
"""Maximum numbers of an array, and maximum characters of any other value, in a message."""
DIGITS_SHOWN = 9
"""Number of digits of a number in a message, which show nanometres of a length of a metre."""


def as_float64(values: Any, name: str, *, expected: str = "numbers") -> np.ndarray:
    """Return *values* as a writeable C-ordered float64 array. If it already is one, it is not copied.

    Kernels are compiled for such arrays only: a read-only one would make numba compile again.

    *values*: booleans, integers, floats of any width, or objects that hold only real numbers; of NumPy or by
    `as_array`. Masked values become nan, and values too large for float64 inf.
    """
    if _is_float64(values):
        return values
    try:
        array = as_array(values, name)
    except ArgumentError:
        raise
    except ValueError as ragged:
        raise ArgumentError(f"{name} have rows of different lengths, expected {expected}") from ragged
    if array.dtype.kind not in "biufO":
        raise ArgumentError(f"{name} have dtype {array.dtype}, expected {expected}")
    if array.dtype.kind == "O":
        _check_numbers(array, name, expected)
    try:
        with np.errstate(over="ignore"):
            if isinstance(array, np.ma.MaskedArray):
                array = np.ma.filled(array.astype(np.float64), np.nan)
            array = np.asarray(array)
            if array.ndim and len(array) > COPIED_AT_ONCE and not _is_float64(array):
                return copied(array)
            return np.require(array, np.float64, ["C", "A", "W"])
    except (OverflowError, TypeError, ValueError) as unfit:
        raise ArgumentError(
            f"{name} contain something that is not a number ({unfit}), expected {expected}"
        ) from unfit


def as_array(values: Any, name: str) -> np.ndarray:
    """Return array-like *values*, also of another library, by ``__array__`` or else by DLPack.

    Raises `ArgumentError` for the memory of a GPU, and if the library refuses. Rows of different lengths are
    NumPy's ValueError.
    """
    device = None if isinstance(values, np.ndarray) else getattr(values, "__dlpack_device__", None)
    try:
        if device is not None:
            kind = int(device()[0])
            if kind not in READABLE_DEVICES:
                raise ArgumentError(
                    f"{name} are in the memory of another device, such as a GPU (DLPack device type {kind}), "
                    "expected an array in main memory: copy it there first"
                )
            if not hasattr(values, "__array__"):
                return np.from_dlpack(values)
        return np.asanyarray(values)
    except (BufferError, RuntimeError, TypeError) as refused:
        reason = " ".join(str(refused).split())
        raise ArgumentError(f"{name} cannot be read as an array ({reason})") from refused


def copied(array: np.ndarray) -> np.ndarray:
    """Return a C-ordered float64 copy of an array.

    It is copied in blocks, so that Ctrl-C takes effect soon. *array*: (N, ...).
    """
    copy = np.empty(array.shape)
    for first in range(0, len(array), COPIED_AT_ONCE):
        copy[first : first + COPIED_AT_ONCE] = array[first : first + COPIED_AT_ONCE]
    return copy


def is_ready(values: Any, shape: tuple[int, ...]) -> bool:
    """Return whether *values* has the given shape and needs no conversion by `as_float64`."""
    return _is_float64(values) and values.shape == shape


def _is_float64(values: Any) -> bool:
    """Return whether the array needs no conversion."""
    return type(values) is np.ndarray and values.dtype is FLOAT64 and values.flags.carray


def _check_numbers(array: np.ndarray, name: str, expected: str) -> None:
    """Raise an error for text and None, which NumPy would convert to numbers and to nan."""
    for value in array.flat:
        if value is None or isinstance(value, (str, bytes)):
            raise ArgumentError(f"{name} hold {value!r}, which is not a number, expected {expected}")


def shown(value: Any) -> str:
    """Return a value as one line for a message. A large array is represented by its dtype and shape."""
    if isinstance(value, np.ndarray) and value.size > FEW_SHOWN:
        return f"an array of {value.dtype}, shape {value.shape}"
    text = " ".join(repr(value).split())
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def shown_number(value: Any) -> str:
    """Return a number with at most nine digits, for the representation of a record.

    *value*: number of Python or NumPy, or an array of numbers, which is shown as lists.
    """
    value = value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
    if isinstance(value, list):
        return f"[{', '.join(map(shown_number, value))}]"
    return repr(float(f"{value:.{DIGITS_SHOWN}g}") if isinstance(value, float) else value)


def trimesh_kind(value: Any) -> str | None:
    """Return "Trimesh" or "Scene" for an object of trimesh, else None.

    trimesh itself is not imported.
    """
    for kind in type(value).__mro__:
        if kind.__module__.split(".")[0] == "trimesh" and kind.__name__ in ("Trimesh", "Scene"):
            return kind.__name__
    return None


def refuse_trimesh(value: Any) -> None:
    """Raise an error if *value* is an object of trimesh. Its message names the conversion."""
    if kind := trimesh_kind(value):
        raise ArgumentError(f"a trimesh.{kind} was given: proximity.from_trimesh makes a scene of it")


def as_points(values: Any, name: str = "points") -> np.ndarray:
    """Return *values* as C-ordered float64 of shape (..., 3).

    *values*: (..., 3) array-like; points or directions. Rows that are not finite are kept. An empty list has
    no rows: (0, 3).
    """
    # The most frequent case takes a fifth of a microsecond.
    if _is_float64(values) and values.shape[-1:] == _ROW:
        return values
    points = as_float64(values, name, expected="numbers of shape (..., 3)")
    if points.shape == (0,):
        return points.reshape(0, 3)
    if points.ndim == 0 or points.shape[-1] != 3:
        raise ArgumentError(f"{name} have shape {points.shape}, expected (..., 3)")
    return points


def as_number(value: Any) -> float:
    """Return *value* as a float; nan if it is not a single real number."""
    if isinstance(value, (bool, str, bytes)) or getattr(value, "ndim", False):
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def positive(
    name: str,
    value: Any,
    unit: str,
    *,
    may_be_infinite: bool = False,
) -> float:
    """Return *value* as a float. Raise an error unless it is above zero.

    *may_be_infinite*: whether inf is allowed, as for a rigid wall.
    """
    number = as_number(value)
    if not (number > 0.0 and (may_be_infinite or number < math.inf)):
        raise ArgumentError(f"{name} is {shown(value)}, expected a positive number of {unit}")
    return number


def not_negative(
    name: str,
    value: Any,
    unit: str,
    *,
    most: float = math.inf,
    may_be_infinite: bool = False,
) -> float:
    """Return *value* as a float. Raise an error unless it is zero or more."""
    number = as_number(value)
    if not (number >= 0.0 and (may_be_infinite or number < math.inf)):
        raise ArgumentError(f"{name} is {shown(value)}, expected a number of {unit} of 0 or more")
    if number > most:
        raise ArgumentError(f"{name} is {shown(value)}, expected a number of {unit} of {most:g} at most")
    return number


def finite(name: str, value: Any, unit: str) -> float:
    """Return *value* as a float of either sign. Raise an error unless it is finite."""
    number = as_number(value)
    if not math.isfinite(number):
        raise ArgumentError(f"{name} is {shown(value)}, expected a number of {unit}")
    return number


def is_whole(value: Any, least: float = -math.inf) -> bool:
    """Return whether *value* is a whole number of Python or NumPy that is at least *least*."""
    try:
        return not isinstance(value, bool) and operator.index(value) >= least
    except TypeError:
        return False


def whole(name: str, value: Any, least: int = 1) -> int:
    """Return *value* as an int. Raise an error unless it is a whole number of at least *least*."""
    if not is_whole(value, least):
        raise ArgumentError(f"{name} is {shown(value)}, expected a whole number of {least} or more")
    return operator.index(value)
