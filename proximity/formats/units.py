"""Units of length that a file or a caller may name."""

from proximity.errors import MeshError

UNITS: dict[str, float] = {
    "m": 1.0,
    "dm": 1e-1,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "nm": 1e-9,
    "km": 1e3,
    "in": 0.0254,
    "ft": 0.3048,
    "yd": 0.9144,
    "mi": 1609.344,
    "mil": 2.54e-5,
}
"""Name of a unit -> metres."""


def metres_per_unit(name: str) -> float:
    """Return the length of one unit in metres."""
    if isinstance(name, str) and name in UNITS:
        return UNITS[name]
    raise MeshError(f"there is no unit {name!r}, expected one of {', '.join(UNITS)}")
