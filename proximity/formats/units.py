"""Units of length of a file or a caller, and the likely unit of a file with an implausible size.

A file that declares no unit is read in the caller's. An inch file read as millimetres is the commonest
mistake: parts are then 25.4 times too small, which only their size can show.
"""

import math
from collections.abc import Sequence

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
PREFIXES = {"": "", "milli": "m", "centi": "c", "deci": "d", "micro": "u", "nano": "n", "kilo": "k"}
SYNONYMS = {prefix + word: short + "m" for prefix, short in PREFIXES.items() for word in ("metre", "meter")}
SYNONYMS |= {
    "micron": "um", "\N{GREEK SMALL LETTER MU}m": "um", "inch": "in", "inche": "in", "foot": "ft",
    "feet": "ft", "yard": "yd", "mile": "mi", "thou": "mil",
}  # fmt: skip
"""Other words for units, in lower case and without a final s."""

SMALLEST_PART = 0.0005
"""m; a smaller part is unlikely."""
LARGEST_PART = 50.0
"""m; a larger part is unlikely."""
SMALL_FILE = 0.010
"""m; a smaller whole file without a unit is more often in inches than of parts this small."""
TYPICAL_PART = 0.1
"""m; of parts touched by hand."""
UNLIKELY_RATIO, ALIKE = math.log(5.0), math.log(2.0)
"""Ratios of the sizes of part and scan: minimum for trying other units, and maximum for the chosen one."""
UNIT_NAMES = {"mm": "millimetres", "in": "inches", "m": "metres", "um": "micrometres"}
"""Units that modelling programs commonly write."""


def unit_name(name: str) -> str:
    """Return the key of `UNITS` for a unit, also if spelt as a word or in capitals."""
    if isinstance(name, str):
        word = name.casefold()
        if (unit := SYNONYMS.get(word.removesuffix("s"), word)) in UNITS:
            return unit
    raise MeshError(f"unknown unit {name!r}, expected one of {', '.join(UNITS)}")


def metres_per_unit(name: str) -> float:
    """Return the length of one unit in metres."""
    return UNITS[unit_name(name)]


def likely_unit(size: float, units: str) -> str | None:
    """Return the unit that makes a size most like a part's, or None if no common unit makes it likely.

    *size*: longest side of a part's box, as read. *units*: its unit, a key of `UNITS`; it is preferred if as
    likely as the others.
    """
    if not 0.0 < size < math.inf:
        return None
    number = size / UNITS[units]
    sizes = {name: number * UNITS[name] for name in (units, *UNIT_NAMES)}
    nearest = min(sizes, key=lambda name: abs(math.log10(sizes[name]) - math.log10(TYPICAL_PART)))
    return nearest if SMALLEST_PART <= sizes[nearest] <= LARGEST_PART else None


def scan_unit(scan: Sequence[float], part: Sequence[float], units: str) -> str | None:
    """Return the unit in which a scan has the size of its part, or None if *units* are likely enough.

    *scan*, *part*: sides of boxes, m; the scan's as read in *units*. Scans of a region are smaller than their
    part, so the two longest sides must differ by the factor of one unit.
    """
    ratios = [own / side if side > 0.0 else 0.0 for side, own in zip(sorted(scan), sorted(part), strict=True)]
    if not all(0.0 < ratio < math.inf for ratio in ratios[1:]) or abs(math.log(ratios[2])) < UNLIKELY_RATIO:
        return None

    def misfit(name: str) -> float:
        return max(abs(math.log(ratio * UNITS[units] / UNITS[name])) for ratio in ratios[1:])

    likeliest = min((*UNIT_NAMES, "cm", "ft"), key=misfit)
    return likeliest if misfit(likeliest) < ALIKE else None


def size_notes(parts: Sequence[tuple[str, float]], whole: float, units: str, is_declared: bool) -> list[str]:
    """Return sentences about unlikely sizes, with the likely unit."""
    small = [part for part in parts if part[1] < SMALLEST_PART]
    large = [part for part in parts if part[1] > LARGEST_PART]
    what = []
    if small:
        extreme = min(small, key=lambda part: part[1])
        what.append(_outliers(small, parts, extreme, f"less than {_length(SMALLEST_PART)}", "smallest"))
    if large:
        extreme = max(large, key=lambda part: part[1])
        what.append(_outliers(large, parts, extreme, f"more than {_length(LARGEST_PART)}", "largest"))
    if not what and whole < SMALL_FILE and not is_declared and likely_unit(whole, units) != units:
        what.append(f"the whole is {_length(whole)} across")
    return [f"{' and '.join(what)}: {_reason(whole, units, is_declared)}"] if what else []


def _outliers(
    outliers: list[tuple[str, float]],
    parts: Sequence[tuple[str, float]],
    extreme: tuple[str, float],
    limit: str,
    superlative: str,
) -> str:
    name, size = extreme[0], _length(extreme[1])
    if len(parts) == 1:
        return f"the part is {size} across"
    if len(outliers) == 1:
        return f"part {name!r} is {size} across"
    return f"{len(outliers)} of {len(parts)} parts are {limit} across, the {superlative} {name!r} {size}"


def _reason(whole: float, units: str, is_declared: bool) -> str:
    units = units.split(", ")[0]  # a STEP file may use several
    origin = f"declares {units}" if is_declared else f"declares no unit and was read in {units}"
    likely = likely_unit(whole, units)
    if likely is None:
        verdict = f"; no common unit makes the whole, {_length(whole)} across, a likely size"
    elif likely == units:
        verdict = f", which is the likely unit for the whole of {_length(whole)}"
    else:
        then = _length(whole / UNITS[units] * UNITS[likely])
        verdict = f"; the likely unit is {likely} ({UNIT_NAMES[likely]}), the whole is then {then} across"
        if is_declared:
            scale = UNITS[likely] / UNITS[units]
            verdict += f"; if it was written in the wrong unit, load it with a scale of {scale:g}"
    return f"the file {origin}{verdict}"


def _length(size: float) -> str:
    return f"{size:.4g} m" if size >= 1.0 else f"{size * 1e3:.4g} mm"
