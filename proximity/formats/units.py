"""Units of length of files and callers, and the likely unit of a file with an implausible size.

A file that declares no unit is read in the caller's unit. The most common mistake is to read a file in inches
as millimetres. Parts are then 25.4 times too small, which only their size can show.
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
"""Length of each unit in metres."""
PREFIXES = {"": "", "milli": "m", "centi": "c", "deci": "d", "micro": "u", "nano": "n", "kilo": "k"}
SYNONYMS = {prefix + word: short + "m" for prefix, short in PREFIXES.items() for word in ("metre", "meter")}
SYNONYMS |= {
    "micron": "um", "\N{GREEK SMALL LETTER MU}m": "um", "inch": "in", "inche": "in", "foot": "ft",
    "feet": "ft", "yard": "yd", "mile": "mi", "thou": "mil",
}  # fmt: skip
"""Other words for units, in lower case and without a final s."""

SMALLEST_PART = 0.0005
"""Minimum likely size of a part, m."""
MAX_PART = 50.0
"""Maximum likely size of a part, m."""
SMALL_FILE = 0.010
"""Size of a whole file without a unit below which it is probably in inches, m. Parts this small are less
frequent."""
TYPICAL_PART = 0.1
"""Typical size of a part that is touched by hand, m."""
UNLIKELY_RATIO, ALIKE = math.log(5.0), math.log(2.0)
"""Ratios of the sizes of part and scan, as logarithms. The minimum at which other units are tried, and the
maximum for the chosen unit."""
UNIT_NAMES = {"mm": "millimetres", "in": "inches", "m": "metres", "um": "micrometres"}
"""Units that modelling programs commonly write."""


def unit_name(name: str) -> str:
    """Return the key of `UNITS` for the name of a unit, which may be a word or in capitals."""
    if isinstance(name, str):
        word = name.casefold()
        if (unit := SYNONYMS.get(word.removesuffix("s"), word)) in UNITS:
            return unit
    raise MeshError(f"unknown unit {name!r}, expected one of {', '.join(UNITS)}")


def metres_per_unit(name: str) -> float:
    """Return the length of one unit in metres."""
    return UNITS[unit_name(name)]


def likely_unit(size: float, units: str) -> str | None:
    """Return the unit in which a size is most like that of a part, or None if no common unit is likely.

    *size*: longest side of a part's box, m. *units*: its unit, a key of `UNITS`. It is returned if it is as
    likely as the others.
    """
    if not 0.0 < size < math.inf:
        return None
    number = size / UNITS[units]
    sizes = {name: number * UNITS[name] for name in (units, *UNIT_NAMES)}
    nearest = min(sizes, key=lambda name: abs(math.log10(sizes[name]) - math.log10(TYPICAL_PART)))
    return nearest if SMALLEST_PART <= sizes[nearest] <= MAX_PART else None


def scan_unit(scan: Sequence[float], part: Sequence[float], units: str) -> str | None:
    """Return the unit in which a scan has the size of its part, or None if *units* are likely enough.

    *scan*, *part*: sides of their boxes, m. The scan was read in *units*. A scan of a region is smaller than
    its part, so the two longest sides must both differ by the factor of one unit.
    """
    ratios = [own / side if side > 0.0 else 0.0 for side, own in zip(sorted(scan), sorted(part), strict=True)]
    if not all(0.0 < ratio < math.inf for ratio in ratios[1:]) or abs(math.log(ratios[2])) < UNLIKELY_RATIO:
        return None

    def misfit(name: str) -> float:
        return max(abs(math.log(ratio * UNITS[units] / UNITS[name])) for ratio in ratios[1:])

    likeliest = min((*UNIT_NAMES, "cm", "ft"), key=misfit)
    return likeliest if misfit(likeliest) < ALIKE else None


def size_notes(parts: Sequence[tuple[str, float]], whole: float, units: str, is_declared: bool) -> list[str]:
    """Return sentences that report unlikely sizes and the likely unit."""
    small = [part for part in parts if part[1] < SMALLEST_PART]
    large = [part for part in parts if part[1] > MAX_PART]
    what = []
    if small:
        extreme = min(small, key=lambda part: part[1])
        what.append(_outliers(small, parts, extreme, f"less than {_length(SMALLEST_PART)}", "smallest"))
    if large:
        extreme = max(large, key=lambda part: part[1])
        what.append(_outliers(large, parts, extreme, f"more than {_length(MAX_PART)}", "largest"))
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
    units = units.split(", ")[0]  # a STEP file may use several units
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
