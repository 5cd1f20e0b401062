"""Upper bounds of the distance between the triangles of a STEP file and its CAD faces, in both directions.

A face of the file and its triangles have the same number, which the corners and the edges confirm. The bound
is the sum of two distances: that of the triangles from the surface of the face, and that of the images of
their outer sides on the surface from the edges of the face. It holds both ways. A point of a triangle has
its image on the face, or between a side and its edge; and the images cover the face, except between a side
and its edge. This assumes that the triangles of a face are a triangulation of it, as the converter reports,
that the sides follow the edges in order, and that the curves of edges lie on their surfaces.

A face for which a bound cannot be proved has an infinite one.
"""

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats.contents import RawMesh
from proximity.formats.step import chords, surface_distance
from proximity.formats.step.cad_faces import CadFace, read_bodies
from proximity.formats.step.step_records import StepText
from proximity.formats.text_rows import listed
from proximity.system.extras import installation
from proximity.system.file_cache import FileCache

_UNREADABLE = (MeshFormatError, TypeError, ValueError, LookupError, ArithmeticError)
"""Errors for records that are not as expected. The converter has read the file, so it is not refused."""
_SINGLE = float(np.finfo(np.float32).eps)
_FIT = 64 * _SINGLE
"""Maximum distance of the corners of a triangle from its CAD face as a share of the size of the part, if that
is more."""
_VERSION = 2
"""Number of the method in the keys of the cache."""
_KINDS = ("plane", "cone", "sphere", "torus")


def cached_deviations(
    text: StepText, meshes: Sequence[RawMesh], fit: float, cache: FileCache | None
) -> list[str]:
    """Set the deviations of meshes as `add_deviations`, or read them from a cache, which may be None."""
    if cache is None:
        return add_deviations(text, meshes, fit)
    shared = list({id(mesh.source_faces): mesh for mesh in meshes}.values())
    settings = f"{_VERSION} {fit} {find_spec('scipy') is not None} "
    digest = hashlib.blake2b(settings.encode() + text.text.encode())
    for mesh in shared:
        for array in (mesh.vertices, mesh.faces, mesh.source_faces):
            digest.update(np.ascontiguousarray(array).tobytes())
    key = digest.hexdigest()
    if (kept := cache.read(key)) is not None:
        found = json.loads(kept)
        arrays = {
            id(mesh.source_faces): np.array(own) for mesh, own in zip(shared, found["bounds"], strict=True)
        }
        for mesh in meshes:
            mesh.deviations = arrays[id(mesh.source_faces)]
        return list(found["notes"])
    notes = add_deviations(text, meshes, fit)
    bounds = [[] if mesh.deviations is None else mesh.deviations.tolist() for mesh in shared]
    cache.write(key, json.dumps({"bounds": bounds, "notes": notes}).encode())
    return notes


def add_deviations(text: StepText, meshes: Sequence[RawMesh], fit: float) -> list[str]:
    """Set the deviations of meshes from the CAD faces of a file. Return notes on those without a bound.

    *fit*: maximum distance of the corners of triangles from their CAD faces, m.
    """
    representations: list[list[CadFace]] = []
    with suppress(*_UNREADABLE):
        for bodies in read_bodies(text):
            representations.append([face for body in bodies for face in body.faces])
            representations += [body.faces for body in bodies if len(bodies) > 1]
    shared: dict[int, np.ndarray] = {}
    notes: dict[int, str] = {}
    for mesh in meshes:
        key = id(mesh.source_faces)
        if key not in shared:
            bounds, reason = (
                np.full(int(mesh.source_faces.max(initial=0)) + 1, np.inf),
                "it cannot be computed",
            )
            with suppress(*_UNREADABLE):
                bounds, reason = _deviations(mesh, representations, fit)
            shared[key] = bounds
            if reason:
                name = mesh.name or "a part"
                notes[key] = f"the deviation of {name} from its CAD surfaces is not bounded: {reason}"
        mesh.deviations = shared[key]
    return list(notes.values())


def _deviations(mesh: RawMesh, representations: list[list[CadFace]], fit: float) -> tuple[np.ndarray, str]:
    """Return the bound of each CAD face of a mesh, m, and the reason for infinite ones."""
    count = int(mesh.source_faces.max(initial=-1)) + 1
    unknown = np.full(max(count, 1), np.inf)
    if (mesh.source_faces < 0).any():
        return unknown, "the numbers of its CAD faces are unknown"
    corners = mesh.vertices[mesh.faces]
    size = float(np.abs(mesh.vertices).max(initial=0.0))
    fit = max(fit, _FIT * size)
    is_present = np.bincount(mesh.source_faces, minlength=count) > 0
    for faces in representations:
        if len(faces) != count or not is_present.all():
            continue
        groups = _by_kind(faces, mesh.source_faces, corners)
        if all(np.abs(group.distances).max(initial=0.0) <= fit for group in groups):
            bounds, reason = _bounds(mesh, faces, corners, groups, fit)
            return bounds + 16 * np.finfo(float).eps * size, reason
    return unknown, "no solid of the file has its faces"


class _Group(NamedTuple):
    """Triangles on one kind of surface."""

    kind: str
    rows: np.ndarray  # (N,) of the triangles
    surfaces: surface_distance.Surfaces  # of each triangle
    distances: np.ndarray  # (N, 3) m, signed, of the corners from the surfaces


def _by_kind(faces: list[CadFace], numbers: np.ndarray, corners: np.ndarray) -> list[_Group]:
    """Return the triangles on each kind of surface of elementary form."""
    kinds = np.array([face.surface.kind for face in faces])
    whole = surface_distance.Surfaces(
        *(
            np.array([getattr(face.surface, name) for face in faces])
            for name in ("origin", "axis", "size", "second")
        )
    )
    groups = []
    for kind in _KINDS:
        rows = np.flatnonzero((kinds == kind)[numbers])
        if len(rows):
            surfaces = whole.rows(numbers[rows])
            distances = surface_distance.signed_distances(kind, surfaces, corners[rows])
            groups.append(_Group(kind, rows, surfaces, distances))
    return groups


def _bounds(
    mesh: RawMesh, faces: list[CadFace], corners: np.ndarray, groups: list[_Group], fit: float
) -> tuple[np.ndarray, str]:
    numbers = mesh.source_faces
    depths, reasons = _depths(faces, numbers, corners, groups)
    curves = chords.Curves.of(faces)
    found = chords.find_chords(mesh.vertices, mesh.faces, numbers, curves)
    bounds = chords.chord_bounds(curves.shapes, found.curves, found.ends[found.rows], fit)
    # Each chord belongs to the curve that it is nearest to.
    order = np.lexsort((bounds, found.rows))
    rows, first = np.unique(found.rows[order], return_index=True)
    sagittas, own = np.full(len(found.ends), np.inf), np.full(len(found.ends), -1)
    sagittas[rows], own[rows] = bounds[order][first], found.curves[order][first]
    by_curve = np.argsort(own, kind="stable")
    starts = np.searchsorted(own[by_curve], np.arange(len(curves.shapes) + 1))
    laterals, radials = np.zeros((2, len(faces)))
    for number, curve, sagitta in _largest(found.groups, own, sagittas):
        if curve < 0 or not sagitta < np.inf:
            laterals[number] = np.inf
            continue
        if np.isinf(depths[number]):
            continue
        ends = found.ends[by_curve[starts[curve] : starts[curve + 1]]]
        surface, shape = faces[number].surface, curves.shapes[curve]
        lateral = chords.lateral_bound(surface, shape, sagitta, depths[number], ends)
        laterals[number] = max(laterals[number], lateral)
        radials[number] = max(radials[number], chords.radial_bound(surface, shape, sagitta))
    for number in np.flatnonzero(np.isinf(laterals)).tolist():
        reasons.setdefault(number, "its triangles do not end at its edges, or an edge is not read")
    missing = np.setdiff1d(np.arange(len(curves.shapes)), found.curves[np.isfinite(bounds)])
    for number in {number for curve in missing for number in curves.faces[curve]}:
        laterals[number] = np.inf
        reasons.setdefault(number, "an edge has no triangles")
    # Perpendicular to the axis of a cone, images are farther away, but end at the edges.
    slopes = np.array([face.surface.second if face.surface.kind == "cone" else 0.0 for face in faces])
    radials[np.isinf(laterals)] = np.inf
    bounds = np.minimum(depths + laterals, depths * np.hypot(1.0, slopes) + radials)
    shown = [f"{faces[row].number} ({faces[row].surface.record}): {reasons[row]}" for row in sorted(reasons)]
    return bounds, f"faces {listed(shown)}" if shown else ""


def _depths(
    faces: list[CadFace], numbers: np.ndarray, corners: np.ndarray, groups: list[_Group]
) -> tuple[np.ndarray, dict[int, str]]:
    """Return a bound of the distance of each face's triangles from its surface, and reasons for infinity."""
    depths, reasons = np.zeros(len(faces)), {}
    for kind, rows, surfaces, distances in groups:
        own = surface_distance.upper_bounds(kind, surfaces, corners[rows], numbers[rows], distances)
        np.maximum.at(depths, numbers[rows], own)
    for row, face in enumerate(faces):
        if face.surface.kind == "other":
            depths[row], reasons[row] = np.inf, "surfaces of this type are not bounded"
        elif face.surface.kind == "spline":
            depths[row], reason = _spline_depth(face, corners[numbers == row])
            if reason:
                reasons[row] = reason
    return depths, reasons


def _spline_depth(face: CadFace, triangles: np.ndarray) -> tuple[float, str]:
    """Return a bound for a spline, and the reason if it is infinite."""
    try:
        from proximity.formats.step import spline_distance
    except ImportError:
        return np.inf, f"free-form faces need SciPy: {installation('service')}"
    assert face.surface.spline is not None, "a surface of the kind spline has one"
    bound = spline_distance.surface_bound(spline_distance.shape_of(face.surface.spline), triangles)
    return bound, "" if bound < np.inf else "it has gaps, or too many pieces"


def _largest(groups: np.ndarray, curves: np.ndarray, sagittas: np.ndarray) -> list[tuple[int, int, float]]:
    """Return the largest sagitta for each face and curve."""
    sides, curves, sagittas = groups.T.ravel(), np.tile(curves, 2), np.tile(sagittas, 2)
    order = np.lexsort((-sagittas, curves, sides))
    is_first = np.ones(len(order), bool)
    is_first[1:] = (np.diff(sides[order]) != 0) | (np.diff(curves[order]) != 0)
    rows = order[is_first]
    return list(zip(sides[rows].tolist(), curves[rows].tolist(), sagittas[rows].tolist(), strict=True))
