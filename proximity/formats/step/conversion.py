"""Convert STEP to GLB by cascadio (OpenCASCADE), with limits of time, memory and triangles.

One process converts all files, since importing OpenCASCADE takes longer than converting most of them. The
triangles are stored in the user's cache.
"""

import hashlib
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress

import numpy as np

from proximity.errors import MeshError, MeshFormatError, MissingLibraryError
from proximity.formats.contents import RawFile
from proximity.formats.gltf import buffers, gltf
from proximity.formats.libraries import Library
from proximity.formats.step.product_structure import with_names_of_products
from proximity.formats.step.step_records import StepText
from proximity.formats.worker import NOT_INSTALLED, TOO_MUCH
from proximity.system.extras import installation
from proximity.system.file_cache import FileCache

STEP_ANGLE = 0.25
"""Maximum angle between neighbouring triangles, radians. It keeps fillets round whose radius is hardly larger
than the tolerance (cascadio's default, 0.5, makes them rings of thirteen sides)."""
MAX_TRIANGLES = 5_000_000
MAX_FACE_TRIANGLES = 150_000
"""Maximum number of triangles of one CAD face. OpenCASCADE takes 4 s for 100 000 and 16 s for 200 000."""
MAX_SECONDS, MAX_BYTES = 600, 8 << 30
"""Limits of time and memory of one conversion."""
CACHE = FileCache("step", 1 << 30)
"""Cache of the triangles of files, with a limit of a gigabyte."""
_CONVERSION = 1  # to be changed if `worker` converts in another way
_FIRST_SHARE = 1e-3
"""Tolerance of the first conversion as a share of the size of the file, if the number of triangles must be
estimated."""
_ROUND_SHARE, _FREE_SHARE = 0.7 * MAX_FACE_TRIANGLES / 10.1, 1e5
"""Minimum radius and minimum size, in tolerances, from which triangles must be estimated. A sphere has 10.1
triangles for each tolerance of its radius."""

_NUMBER = re.compile(r"(?<![\w.#+-])[-+]?\d+\.\d*(?:E[-+]?\d+)?")
_ROUND = re.compile(r"\b(?:SPHERICAL|(?:DEGENERATE_)?TOROIDAL)_SURFACE\s*+\(([^)]*+)")
FREE_FORM = re.compile(r"\bB_SPLINE_SURFACE|\bSURFACE_OF_|\bOFFSET_SURFACE")
_STYLED = re.compile(r"(STYLED_ITEM\s*+\(\s*+'[^']*+'\s*+,\s*+)\([^)]*+\)")
_COMPLAINT = re.compile(r"\bERR\b|Error|Exception|Fails Count", re.IGNORECASE)
_ESCAPES = re.compile(r"\x1b\[[0-9;]*m")


class _LimitError(MeshFormatError):
    """Raised for a conversion that exceeds its limits."""


_Mesher = Callable[[float], RawFile]  # converts with a tolerance, m
_shared = threading.local()


@contextmanager
def converter() -> Iterator[Library]:
    """Yield the process that converts files.

    The first file starts it, and nested blocks share it.
    """
    outer = getattr(_shared, "library", None)
    with nullcontext(outer) if outer else Library("step", MAX_SECONDS, MAX_BYTES) as library:
        _shared.library = library
        try:
            yield library
        finally:
            _shared.library = outer


def mesh_within_limits(
    text: StepText, path: str, tolerance: float, metres: float, *, is_cached: bool
) -> tuple[RawFile, float]:
    """Convert a file to triangles. Return it and the tolerance of the triangles, m.

    The tolerance is larger than *tolerance* if that would take too many triangles. *metres*: the longest unit
    of the file, m. *is_cached*: whether triangles are read from the user's cache, or stored there.
    """
    data = _without_styles(text.text).encode()

    def mesh(tolerance: float) -> RawFile:
        header, binary, _ = buffers.split_glb(_convert(data, tolerance, is_cached))
        # Nodes have numbers of assembly steps (NAUO1) as names; users know the products.
        return gltf.read_document(with_names_of_products(header, text), path, binary, "STEP", [])

    with converter():
        size = _deciding_size(text, tolerance / metres) * metres
        if size:
            return _mesh_by_and_by(mesh, tolerance, max(tolerance, size * _FIRST_SHARE))
        with suppress(_LimitError):
            raw = mesh(tolerance)
            if _triangle_counts(raw)[0] <= MAX_TRIANGLES:
                return raw, tolerance
        size = _largest(_NUMBER.findall(text.blank)) * metres
        return _mesh_by_and_by(mesh, tolerance, max(10 * tolerance, size * _FIRST_SHARE))


def _mesh_by_and_by(mesh: _Mesher, tolerance: float, coarse: float) -> tuple[RawFile, float]:
    """Convert with a coarse tolerance, and approach the wanted one as closely as the limits permit."""
    raw = mesh(coarse)
    while coarse > tolerance:
        total, most = _triangle_counts(raw)
        # Triangles grow with 1 / tolerance on doubly curved surfaces, more slowly elsewhere.
        finer = max(tolerance, coarse * max(total / MAX_TRIANGLES, most / MAX_FACE_TRIANGLES))
        factor = coarse / tolerance
        excess = (
            f"not {tolerance * 1e3:g} mm: it would take up to {total * factor:.2g} triangles, "
            f"{most * factor:.2g} of them on one CAD face, expected at most {MAX_TRIANGLES:,} and "
            f"{MAX_FACE_TRIANGLES:,}"
        )
        if finer > 1.5 * coarse:
            raise MeshFormatError(
                f"it takes {total:,} triangles within {coarse * 1e3:.2g} mm already, {excess}"
            )
        try:
            if finer > max(0.8 * coarse, tolerance):
                raise _LimitError
            raw, coarse = mesh(finer), finer
        except _LimitError:
            raw.notes.append(f"curved faces are approximated within {coarse * 1e3:.2g} mm, {excess}")
            break
    return raw, coarse


def _deciding_size(text: StepText, tolerance: float) -> float:
    """Return the size of the file, in its numbers, if it may give too many triangles, else 0.0."""
    radius = max((_largest(_NUMBER.findall(match)) for match in _ROUND.findall(text.blank)), default=0.0)
    is_free = FREE_FORM.search(text.blank) is not None
    if radius > _ROUND_SHARE * tolerance or is_free:
        size = _largest(_NUMBER.findall(text.blank))
        if radius > _ROUND_SHARE * tolerance or size > _FREE_SHARE * tolerance:
            return size
    return 0.0


def _largest(numbers: list[str]) -> float:
    """Return the largest absolute value of the finite numbers, or 0.0."""
    values = np.abs(np.array(numbers or ["0"], np.float64))
    return float(values[np.isfinite(values)].max(initial=0.0))


def _triangle_counts(raw: RawFile) -> tuple[int, int]:
    """Return the number of triangles of all products, and that of the largest known CAD face."""
    products = {id(mesh.source_faces): mesh.source_faces for mesh in raw.meshes}.values()
    most = max((int(np.bincount(rows[rows >= 0], minlength=1).max()) for rows in products), default=0)
    return sum(len(rows) for rows in products), most


def _without_styles(text: str) -> str:
    """Return a text without its colours.

    With colours cascadio numbers the CAD faces of faces in several colours wrongly.
    """
    return text if "INVISIBILITY" in text else _STYLED.sub(r"\1()", text)


def _convert(data: bytes, tolerance: float, is_cached: bool) -> bytes:
    settings = f"{_CONVERSION} {_cascadio_version()} {tolerance} {STEP_ANGLE} "
    key = hashlib.blake2b(settings.encode() + data).hexdigest()
    if is_cached and (kept := CACHE.read(key)) is not None:
        return kept
    try:
        with converter() as library:
            # cascadio takes mm, and triangles stay within half of the tolerance
            done = library.run(data, tol_linear=tolerance * 1e3, tol_angular=STEP_ANGLE)
    except OSError as failure:  # the disk is full, or memory is too short for another process
        reported = failure.strerror or str(failure)
        raise MeshError(f"OpenCASCADE cannot be handed it in a temporary folder ({reported})") from failure
    printed = _ESCAPES.sub("", done.printed)
    complaint = next((line.strip(" *\t") for line in printed.splitlines() if _COMPLAINT.search(line)), "")
    if done.returncode < 0:
        raise MeshFormatError(f"OpenCASCADE crashed on it (signal {-done.returncode})")
    if done.returncode == NOT_INSTALLED:
        raise MissingLibraryError(
            f"STEP files need the package cascadio, which cannot be imported: {installation('step')}"
        )
    if done.returncode == TOO_MUCH or "alloc" in printed:
        raise _LimitError(
            f"OpenCASCADE takes more than {MAX_SECONDS} s or {MAX_BYTES >> 30} GB to mesh it within "
            f"{tolerance * 1e3:g} mm, expected less"
        )
    if done.returncode or complaint or not done.output:
        reported = f": {' '.join(complaint.split())[:160]}" if complaint else ""
        raise MeshFormatError(f"OpenCASCADE could not read all of it{reported}")
    if is_cached:
        CACHE.write(key, done.output)
    return done.output


def _cascadio_version() -> str:
    import importlib.metadata  # takes 20 ms

    with suppress(importlib.metadata.PackageNotFoundError):
        return importlib.metadata.version("cascadio")
    return ""
