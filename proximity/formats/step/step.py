"""Read STEP files, which cascadio (OpenCASCADE) converts to GLB.

OpenCASCADE continues after errors: it skips entities that it cannot resolve, reports so on standard output,
and returns the rest. So its output is captured and treated as errors. The CAD faces are counted against those
that the shells of the file list, and the parts against the uses in its assemblies. Positions have single
precision, 1e-7 of a part's size, because cascadio provides no more.
"""

import re
from collections.abc import Callable

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats.contents import UNKNOWN_FACE, RawFile, RawMesh, Source
from proximity.formats.step import conversion, product_structure
from proximity.formats.step.deviation import cached_deviations
from proximity.formats.step.external_parts import with_external_parts, without_trailer
from proximity.formats.step.step_records import REFERENCE, StepText
from proximity.formats.text_rows import listed
from proximity.formats.units import UNITS, metres_per_unit

_SI_PREFIXES = {
    "$": "m",
    ".DECI.": "dm",
    ".CENTI.": "cm",
    ".MILLI.": "mm",
    ".MICRO.": "um",
    ".NANO.": "nm",
    ".KILO.": "km",
}
_CONVERSIONS = {"INCH": "in", "FOOT": "ft", "YARD": "yd", "MILE": "mi", "MIL": "mil", "MILLIMETRE": "mm"}
_CONTEXT = re.compile(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*+\(\s*+\(([^)]*+)")
_SI_METRE = re.compile(r"SI_UNIT\s*+\(\s*+(\$|\.\w++\.)\s*+,\s*+\.METRE\.")
_MAX_ATTEMPTS = 2
"""Maximum number of conversions with a finer tolerance."""
_MARGIN, _LEAST_SHARE = 0.8, 1 / 4
"""Factor of the finer tolerance, since deviations are only nearly proportional to it, and its minimum as a
share of the last one."""
_GAIN = 0.95
"""Minimum improvement for which finer triangles replace coarse ones."""
_MOST_TRIANGLES = 250_000
"""Estimated number of triangles from which a file is not converted again: that would take minutes."""
_ASSUMED_METRES = 1e-3  # OpenCASCADE's unit of numbers without a unit


def read_step(
    source: Source, *, tolerance: float, undeclared_metres: float, is_cached: bool = True
) -> RawFile:
    """Read a STEP file as triangles within *tolerance*, m.

    *undeclared_metres*: length of one unit if the file declares no unit, m.
    """
    own_text, notes = without_trailer(source.data)
    text = StepText(with_external_parts(own_text, source.path, notes))
    units = _units(text)
    body_count = product_structure.count_bodies(text)
    metres = max((metres_per_unit(unit) for unit in units if unit in UNITS), default=_ASSUMED_METRES)
    cache = conversion.CACHE if is_cached else None
    with conversion.converter():

        def mesh(tolerance: float) -> tuple[RawFile, float]:
            return conversion.mesh_within_limits(text, source.path, tolerance, metres, is_cached=is_cached)

        raw, reached = mesh(tolerance)
        notes += _notes_on_faces(text, raw)
        if len(raw.meshes) < body_count:
            raise MeshFormatError(
                f"its assemblies hold {body_count} parts, but OpenCASCADE could read {len(raw.meshes)} only"
            )
        unbounded = cached_deviations(text, raw.meshes, tolerance, cache)
        if reached == tolerance:
            notes.append(
                f"curved faces are approximated within {tolerance * 1e3:g} mm by flat triangles: distances "
                "are exact to the triangles"
            )
            notes += _mesh_finer(
                raw, tolerance, mesh, lambda meshes: cached_deviations(text, meshes, tolerance, cache)
            )
    if unbounded and conversion.FREE_FORM.search(text.blank):
        notes.append(
            "on free-form faces, which the file has, OpenCASCADE may exceed the tolerance: measure with two "
            "tolerances where that matters"
        )
    notes += unbounded
    raw.notes += notes
    raw.approximation = reached
    raw.units = ", ".join(units) or None
    raw.metres_per_number = 1.0 if units else undeclared_metres / _ASSUMED_METRES
    return raw


def _mesh_finer(
    raw: RawFile,
    tolerance: float,
    mesh: Callable[[float], tuple[RawFile, float]],
    add_deviations: Callable[[list[RawMesh]], object],
) -> list[str]:
    """Replace meshes that deviate by more than the tolerance, m, by finer ones. Return notes.

    *mesh*: converts the file with another tolerance. On some free-form faces it exceeds any tolerance: then
    the coarse triangles stay.
    """
    coarse = [one for one in raw.meshes if _deviation(one) > tolerance]
    if not coarse:
        return []
    first = worst = max(map(_deviation, coarse))
    finer, count, is_too_much = tolerance, _triangle_count(raw), False
    for _ in range(_MAX_ATTEMPTS):
        step = _MARGIN * max(tolerance / worst, _LEAST_SHARE)
        finer, count = finer * step, count / step
        is_too_much = count > _MOST_TRIANGLES
        if is_too_much:
            break
        try:
            again, _ = mesh(finer)
        except MeshFormatError:  # it takes too many triangles
            break
        if len(again.meshes) != len(raw.meshes):
            break
        count = _triangle_count(again)
        add_deviations(again.meshes)
        for old, new in zip(raw.meshes, again.meshes, strict=True):
            is_bounded = new.deviations is not None and bool(np.isfinite(new.deviations).all())
            if _deviation(old) > tolerance and is_bounded and _deviation(new) < _GAIN * _deviation(old):
                old.vertices, old.faces, old.source_faces = new.vertices, new.faces, new.source_faces
                old.deviations = new.deviations
        last, worst = worst, max(map(_deviation, raw.meshes))
        if worst <= tolerance or worst == last:
            break
    names = listed(list(dict.fromkeys(one.name or "a part" for one in coarse)))
    exceeded = (
        f"{names}: triangles within {tolerance * 1e3:g} mm deviate by up to {first * 1e3:.3g} mm from the "
    )
    if worst == first:
        reason = f"would be more than {_MOST_TRIANGLES:,}" if is_too_much else "do not improve it"
        return [f"{exceeded}CAD surfaces, and finer ones {reason}"]
    return [exceeded + f"CAD surfaces; finer ones are used, which deviate by up to {worst * 1e3:.3g} mm"]


def _triangle_count(raw: RawFile) -> float:
    return float(sum(len(one.faces) for one in raw.meshes))


def _deviation(mesh: RawMesh) -> float:
    """Return the largest deviation of a mesh, m, or 0.0 if it is not bounded: finer triangles do not help."""
    largest = 0.0 if mesh.deviations is None else float(mesh.deviations.max(initial=0.0))
    return largest if np.isfinite(largest) else 0.0


def _units(text: StepText) -> list[str]:
    """Return the sorted names of the length units that the representations of the file use."""
    by_id: dict[str, str] = {}
    for record in text.records(""):
        if not re.search(r"\bLENGTH_UNIT\b", record.arguments):
            continue
        prefixed = _SI_METRE.search(record.arguments)
        if "CONVERSION_BASED_UNIT" in record.arguments and record.strings:
            name = record.strings[0].strip().upper()
            by_id[record.own] = _CONVERSIONS.get(name, name.lower() or "?")
        elif prefixed:
            by_id[record.own] = _SI_PREFIXES.get(prefixed[1], "?")
    contexts = [REFERENCE.findall(found) for found in _CONTEXT.findall(text.blank)]
    return sorted({by_id[own] for context in contexts for own in context if own in by_id})


def _notes_on_faces(text: StepText, raw: RawFile) -> list[str]:
    """Compare the number of CAD faces with that in the shells. Return notes on faces without a product."""
    shells = {record.own: set(record.references) for record in text.records("CLOSED_SHELL", "OPEN_SHELL")}
    # A product with several placements shares its arrays.
    products = {id(mesh.source_faces): mesh.source_faces for mesh in raw.meshes}
    arrived = sum(len(np.unique(rows)) for rows in products.values())
    listed: set[str] = set().union(*shells.values())
    if arrived >= len(listed) or any(UNKNOWN_FACE in rows for rows in products.values()):
        return []
    used = product_structure.used_records(text)
    unused = listed.difference(*(faces for shell, faces in shells.items() if shell in used))
    if arrived < len(listed) - len(unused):
        raise MeshFormatError(
            f"its shells list {len(listed)} faces, but OpenCASCADE could mesh {arrived} only; "
            "export it in another format, as 3MF"
        )
    return [f"{len(unused)} faces were left out: no product uses their shells"]
