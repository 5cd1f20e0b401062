"""STEP: converted by cascadio (OpenCASCADE) into a GLB document, which is then read like any other.

OpenCASCADE goes on where it should stop: it skips entities that it cannot resolve, says so on standard
output, and hands over the rest. So its words are caught and taken for errors; the CAD faces that arrive are
counted against those that the shells of the file list, and the parts against what its assemblies use.
Positions come in single precision, 1e-7 of a part's size: no more than that can be had from cascadio.

The conversion runs in a process of its own: damaged files can crash OpenCASCADE, and its output can only be
caught by exchanging file descriptors, which would swallow what other threads print.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from proximity.errors import MeshError, MeshFormatError
from proximity.formats.contents import RawFile, Source
from proximity.formats.gltf import buffers, gltf
from proximity.formats.step import product_structure, worker

STEP_TOLERANCE = 1e-5
"""How far flat triangles may leave the curved surface, m: a tenth of what a fingertip can feel. Halving it
gives about 1.4 times as many triangles."""

STEP_ANGLE = 0.25
"""How far neighbouring triangles may turn against each other, radians: keeps fillets round whose radius is
hardly larger than the tolerance (cascadio's own default, 0.5, makes them rings of thirteen sides)."""

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
_SHELL = re.compile(r"\b(?:CLOSED|OPEN)_SHELL\s*\(\s*'(?:[^']|'')*'\s*,\s*\(([^)]*)\)")
_END = re.compile(rb"END-ISO-10303-21\s*;")
_TRAILER = re.compile(_END.pattern + rb"\s*$")
_COMPLAINT = re.compile(r"\bERR\b|Error|Exception|Fails Count", re.IGNORECASE)
_ESCAPES = re.compile(r"\x1b\[[0-9;]*m")
_ASSUMED_METRES = 1e-3  # what OpenCASCADE takes for a number without a unit


def read_step(source: Source, *, tolerance: float, undeclared_metres: float) -> RawFile:
    """Mesh a STEP file.

    Parameters
    ----------
    source : Source
        The file.
    tolerance : float
        How far triangles may leave the surface, m.
    undeclared_metres : float
        What a number means if the file declares no unit, m.

    Raises
    ------
    MeshFormatError
        If the file is cut, damaged, or not all of its faces and parts could be meshed and placed.
    MeshError
        If cascadio is not there, or cannot be started.
    """
    if not _TRAILER.search(source.data[-200:]):
        raise MeshFormatError("it does not end with END-ISO-10303-21: it is cut off")
    if len(_END.findall(source.data)) > 1:
        raise MeshFormatError(
            "it is several STEP files in one, of which OpenCASCADE would read the first only"
        )
    text = source.data.decode("latin-1")
    units = _units(text)
    body_count = product_structure.count_bodies(text)
    try:
        glb = _convert(source.data, tolerance)
    except OSError as failure:  # a full disk, no room for another process
        reported = failure.strerror or str(failure)
        raise MeshError(f"OpenCASCADE cannot be handed it in a temporary folder ({reported})") from failure
    header, binary, _ = buffers.split_glb(glb)
    # Nodes carry numbers of assembly steps (NAUO1); people know the products.
    raw = gltf.read_document(header, source.path, binary, "STEP", [], named_after_meshes=True)
    _check_faces(text, raw)
    if len(raw.meshes) < body_count:
        raise MeshFormatError(
            f"its assemblies hold {body_count} parts, but OpenCASCADE could read {len(raw.meshes)} only"
        )
    raw.notes.append(
        f"curved faces are approximated within {tolerance * 1e3:g} mm by flat triangles: distances "
        "are exact to the triangles"
    )
    raw.units = ", ".join(units) or None
    raw.metres_per_number = 1.0 if units else undeclared_metres / _ASSUMED_METRES
    return raw


def _convert(data: bytes, tolerance: float) -> bytes:
    with tempfile.TemporaryDirectory(prefix="proximity-") as folder:
        step, glb, log = (Path(folder, name) for name in ("part.step", "part.glb", "log.txt"))
        step.write_bytes(data)
        # No -m: the worker shall find cascadio where this process would, and import nothing of ours.
        settings = {
            "path": sys.path,
            "step": str(step),
            "glb": str(glb),
            # cascadio takes millimetres, and triangles stay within half of what it is given
            "tol_linear": tolerance * 1e3,
            "tol_angular": STEP_ANGLE,
        }
        with log.open("wb") as output:
            done = subprocess.run(
                [sys.executable, "-P", worker.__file__],
                input=json.dumps(settings).encode(),
                stdout=output,
                stderr=subprocess.STDOUT,
                check=False,
            )
        printed = _ESCAPES.sub("", log.read_text("utf-8", "replace"))
        complaint = next((line.strip(" *\t") for line in printed.splitlines() if _COMPLAINT.search(line)), "")
        if done.returncode < 0:
            raise MeshFormatError(f"OpenCASCADE crashed on it (signal {-done.returncode})")
        if done.returncode == worker.NO_CASCADIO:
            raise MeshError("STEP files need the package cascadio, which cannot be imported")
        if done.returncode or complaint or not glb.exists() or not glb.stat().st_size:
            reported = f": {' '.join(complaint.split())[:160]}" if complaint else ""
            raise MeshFormatError(f"OpenCASCADE could not read all of it{reported}")
        return glb.read_bytes()


def _units(text: str) -> list[str]:
    """Names of the length units that the representations of the file are in, sorted."""
    by_id: dict[str, str] = {}
    for match in re.finditer(r"#(\d+)\s*=\s*\(([^;]*\bLENGTH_UNIT\b[^;]*)\)\s*;", text):
        body = match.group(2)
        converted = re.search(r"CONVERSION_BASED_UNIT\s*\(\s*'([^']*)'", body)
        prefixed = re.search(r"SI_UNIT\s*\(\s*(\$|\.\w+\.)\s*,\s*\.METRE\.", body)
        if converted:
            name = converted.group(1).strip().upper()
            by_id[match.group(1)] = _CONVERSIONS.get(name, name.lower() or "?")
        elif prefixed:
            by_id[match.group(1)] = _SI_PREFIXES.get(prefixed.group(1), "?")
    used = set()
    for match in re.finditer(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)", text):
        used |= {by_id[unit_id] for unit_id in re.findall(r"#(\d+)", match.group(1)) if unit_id in by_id}
    return sorted(used)


def _check_faces(text: str, raw: RawFile) -> None:
    """Compare the CAD faces that arrived with those that shells list."""
    listed: set[str] = set()
    for match in _SHELL.finditer(text):
        listed.update(re.findall(r"#\d+", match.group(1)))
    # A product that stands in several places shares its arrays.
    products = {id(mesh.source_faces): mesh.source_faces for mesh in raw.meshes}
    arrived = sum(len(np.unique(rows)) for rows in products.values())
    if arrived < len(listed):
        raise MeshFormatError(
            f"its shells list {len(listed)} faces, but OpenCASCADE could mesh {arrived} only"
        )
