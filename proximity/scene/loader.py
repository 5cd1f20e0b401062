"""Load files as scenes."""

import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import ArgumentError, MeshError, PoseError, UnitsWarning
from proximity.formats import (
    STEP_TOLERANCE,
    UNPACKED_LIMIT,
    Geometry,
    read_geometries,
    size_notes,
    unit_name,
)
from proximity.kernels.layout import EXTENSION, MAGIC
from proximity.scene.model.scene_state import SceneState
from proximity.scene.part import LoadReport, Part, parts_of_mesh, with_deviations
from proximity.scene.scene import Scene
from proximity.scene.scene_parts import SceneParts
from proximity.system.regular_file import open_regular


def load(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    scale: float = 1.0,
    step_tolerance: float = STEP_TOLERANCE,
    unpacked_limit: float = UNPACKED_LIMIT,
    cache: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Scene:
    """Load a scene from a file of triangles, from a STEP file, or from a file of `Scene.save`.

    The formats are STL, OBJ, PLY, OFF, glTF, GLB, 3MF and STEP.

    Parameters
    ----------
    path : path
        The file.
    units : str
        Unit of the coordinates if the file declares none: "mm" (the default), "m", "in", ...;
        ``scene.report`` has the one used. A `UnitsWarning` is issued if the file declares another.
    scale : float
        Factor of all lengths: 0.001 for a file in millimetres that declares metres.
    step_tolerance : m
        Largest deviation of triangles from the curved surfaces of a STEP file; distances are exact to the
        triangles. ``scene.report`` repeats it.
    unpacked_limit : bytes
        Largest unpacked size of a 3MF file, which is an archive.
    cache : bool
        Whether the triangles of a STEP file are read from, and written to, the user's cache.
    progress : callable
        Called after each mesh with the number of meshes prepared and their total. Not called for a compiled
        scene.

    Returns
    -------
    Scene
        In metres. Names and poses are those of the file; a part with several bodies is split.

    Raises
    ------
    MeshFormatError
        If the file is missing, damaged, or not in the format of its name. A file is never read in part.
    MeshError
        If its contents cannot be used, *units* are unknown, or an option is out of range.
    ArgumentError
        If a compiled scene is to be scaled.

    Notes
    -----
    Vertices at equal positions are welded, near ones only if that closes a body. Faces without area and
    exact duplicates are dropped. ``part.repairs`` counts the repairs; ``part.source_faces`` has the rows of
    the file's faces. If parts have an unlikely size, ``scene.report.notes`` names the likely unit.

    A saved scene is memory-mapped; only its checksum is computed. Processes that have it open share the
    memory. Do not modify the file in place while it is open; saving again replaces it, which is safe. It is
    recognised by its first bytes, not by its name. ``report`` is that of the original file.
    """
    if _is_compiled(path):
        unit_name(units or "mm")  # raises for an unknown unit, as for any file
        if scale != 1.0:
            why = "a compiled scene is not scaled; compile it with a scale"
            raise ArgumentError(f"{os.fsdecode(path)}: {why}")
        scene = _compiled_scene(os.fsdecode(path))
    else:
        contents = read_geometries(
            path,
            units=units or "mm",
            scale=scale,
            step_tolerance=step_tolerance,
            unpacked_limit=unpacked_limit,
            cache=cache,
        )
        report = LoadReport(
            contents.path,
            contents.format,
            contents.units,
            contents.units_declared,
            contents.notes,
            contents.approximation,
        )
        scene = scene_of(_counted(contents.geometries, progress), os.fspath(path), report)
    # Not for calls from the package: its commands take the unit of answers by the same option.
    if units and not sys._getframe(1).f_globals.get("__name__", "").startswith("proximity."):
        _warn_of_units(scene, unit_name(units))
    return scene


def _is_compiled(path: Any) -> bool:
    """Return whether *path* is a regular file with the signature or the extension of a compiled scene."""
    try:
        name = os.fsdecode(path)
        with open_regular(name) as file:
            begins_so = file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError, TypeError):
        return False
    return begins_so or Path(name).suffix.lower() == EXTENSION


def joined(scenes: Sequence[Scene]) -> Scene:
    """Return one scene with the parts of several scenes at their poses. Parts of equal name are numbered."""
    named = [part for scene in scenes for part in scene.parts]
    parts = _with_own_names(named)
    reports = [scene.report for scene in scenes if scene.report is not None]
    notes = [f"{report.path}: {note}" for report in reports for note in report.notes]
    if renamed := [new.name for old, new in zip(named, parts, strict=True) if old is not new]:
        notes.append(f"parts of several files have one name; numbered: {', '.join(renamed[:10])}")
    whole = Scene(parts)
    whole.report = LoadReport(
        " + ".join(report.path for report in reports),
        ", ".join(dict.fromkeys(report.format for report in reports)),
        ", ".join(dict.fromkeys(report.units for report in reports)),
        all(report.units_declared for report in reports),
        tuple(notes),
        max((report.approximation for report in reports), default=0.0),
    )
    return whole


def _warn_of_units(scene: Scene, units: str) -> None:
    """Warn that the caller's unit has no effect because the file declares another."""
    report = scene.report
    if report is not None and units not in report.units.split(", "):
        warnings.warn(
            f"{report.path}: units={units!r} has no effect, as lengths of the file are in {report.units}; "
            "multiply them by scale= where they are not",
            UnitsWarning,
            stacklevel=3,
        )


def _counted(
    geometries: Sequence[Geometry], progress: Callable[[int, int], None] | None
) -> Iterator[Geometry]:
    for count, geometry in enumerate(geometries, start=1):
        yield geometry
        if progress is not None:
            progress(count, len(geometries))


def scene_of(geometries: Iterable[Geometry], origin: str, report: LoadReport) -> Scene:
    """Return the scene of meshes at their poses. Each mesh is split into bodies.

    *geometries*: at least one; those that share their arrays share their trees.
    """
    parts = _parts_of(geometries, origin)
    try:
        scene = Scene._of_parts(SceneParts.of_new(parts), report)
    except PoseError as unfit:
        raise MeshError(f"{origin}: {unfit}") from unfit
    scene.report = replace(report, notes=(*report.notes, *notes_on_sizes(scene)))
    return scene


def _parts_of(geometries: Iterable[Geometry], origin: str) -> list[Part]:
    """Return the parts of meshes, with distinct names."""
    parts: list[Part] = []
    first_of: dict[tuple[int, int], tuple[Geometry, list[Part]]] = {}
    for geometry in geometries:
        arrays = id(geometry.vertices), id(geometry.faces)
        if arrays not in first_of:
            first_of[arrays] = geometry, _bodies(geometry, origin)
        first, bodies = first_of[arrays]
        # Meshes that share their arrays are validated and given a tree once.
        parts += [
            replace(
                with_deviations(body, geometry.deviations),
                name=geometry.name + body.name.removeprefix(first.name),
                pose=geometry.pose,
                is_hidden=geometry.is_hidden,
            )
            for body in bodies
        ]
    return _with_own_names(parts)


def notes_on_sizes(scene: Scene) -> list[str]:
    """Return a note for ``scene.report`` if parts have an unlikely size, otherwise an empty list."""
    assert scene.report is not None, "a scene read from a file has a report"
    lower, upper = scene.bounds
    with np.errstate(over="ignore"):
        whole = float((upper - lower).max())
    sides = scene.part_sizes.max(axis=1).tolist()
    named = [(part.name, side) for part, side in zip(scene.parts, sides, strict=True)]
    return size_notes(named, whole, scene.report.units, scene.report.units_declared)


def _bodies(geometry: Geometry, origin: str) -> list[Part]:
    try:
        return parts_of_mesh(
            geometry.vertices, geometry.faces, source_faces=geometry.source_faces, name=geometry.name
        )
    except MeshError as unusable:
        raise type(unusable)(f"{origin}, part {geometry.name!r}: {unusable}") from unusable


def _compiled_scene(path: str) -> Scene:
    from proximity.scene.saved.compiled_scene import read_scene  # loads kernels that other files do not need

    compiled = read_scene(path)
    parts, report = [Part(**fields) for fields in compiled.parts], compiled.report
    loaded = None if report is None else LoadReport(**{**report, "notes": tuple(report["notes"])})
    scene = Scene._of_parts(SceneParts(parts, SceneState(compiled.model)), loaded)  # with its trees
    if scene.report is None:
        scene.report = LoadReport(path, "compiled scene", "m", True, ())
        scene.report = replace(scene.report, notes=tuple(notes_on_sizes(scene)))
    return scene


def _with_own_names(parts: list[Part]) -> list[Part]:
    """Number later parts whose name is in use, so that all names differ.

    Names may be equal if a file has a part "a.1" and a part "a" of several bodies.
    """
    taken: set[str] = set()
    renamed: list[Any] = []
    for part in parts:
        name, number = part.name, 1
        while name in taken:
            number += 1
            name = f"{part.name}#{number}"
        taken.add(name)
        renamed.append(part if name == part.name else replace(part, name=name))
    return renamed
