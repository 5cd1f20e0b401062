"""Verify the requirements of a file."""

import hashlib
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from proximity.errors import ArgumentError, ProximityError, SceneError
from proximity.formats.step.conversion import converter
from proximity.requirements.measurements import KINDS, Subject, deviation_of, pose_at_end, verify_subject
from proximity.requirements.records import RANKS, ROUNDING, Requirement, Verification, VerifiedRequirement
from proximity.requirements.requirements_file import RequirementsFile, read_requirements
from proximity.scene.loader import joined, load
from proximity.scene.pairs import Relation
from proximity.scene.scene import Scene
from proximity.service.config import PartFiles, read_scene_file
from proximity.service.config.toml_document import Path as KeyPath
from proximity.system.regular_file import open_regular

Pair = tuple[str, str]
SCENE_FILE, BLOCK_BYTES = ".toml", 1 << 20
DEVIATION_NOTE = "bounds include the deviation of the triangles of STEP files from the CAD surfaces"


class _Models(NamedTuple):
    """The models of a file as one scene."""

    scene: Scene
    approximations: dict[str, float]  # m, of the file of each part
    files: tuple[str, ...]
    notes: tuple[str, ...]


def verify(path: str | os.PathLike[str], *, cache: bool = True) -> Verification:
    """Verify the requirements of a file: gaps and clashes of the parts of a model.

    Parameters
    ----------
    path : path
        The file of requirements, in TOML. Models are relative to it.
    cache : bool
        Whether the triangles of a STEP file are read from, and written to, the user's cache.

    Returns
    -------
    Verification
        The verdict on each requirement, with bounds and points of each pair of parts.

    Raises
    ------
    ServiceError
        If the file cannot be read or used, or a model cannot be loaded; the message has line and key. Also if
        a name matches no part, no pair is left to measure, or an open part has no inside where one is needed.
    MissingLibraryError
        If a model is a STEP file, and the library that reads it is not installed.

    Notes
    -----
    Degenerate: a length equal to its limit is accepted; the allowance for rounding is 1e-9 of the longest
    side of the model. Hidden parts are measured, too.
    Cost: that of `Scene.clearance` or `Scene.clearance_along` for each pair.
    """
    started = time.perf_counter()
    file = read_requirements(path)
    models = _load(file, cache)
    lower, upper = models.scene.bounds
    rounding = ROUNDING * float((upper - lower).max())
    verified = tuple(_verify(file, models, each, rounding) for each in file.requirements)
    names = (os.fsdecode(path), *models.files, *file.pose_files)
    settings = file.settings
    return Verification(
        os.fsdecode(path),
        verified,
        file.units,
        {"units": file.units, "scale": settings.scale, "step_tolerance": settings.step_tolerance},
        {name: _digest(name) for name in dict.fromkeys(names)},
        _digest_of_parts(models.scene),
        models.notes,
        time.perf_counter() - started,
    )


def _load(file: RequirementsFile, cache: bool) -> _Models:
    """Load the models and join them to one scene in which all parts are visible."""
    scenes, files, settings = [], list(file.settings.model), file.settings
    options = {"step_tolerance": settings.step_tolerance / 1e3, "cache": cache}
    with converter():
        for name in settings.model:
            try:
                if Path(name).suffix.lower() == SCENE_FILE:
                    entry = read_scene_file(name)
                    files += [part.file for part in entry.parts]
                    scenes.append(PartFiles(**options).scene(entry))
                else:
                    scenes.append(load(name, units=settings.units, scale=settings.scale, **options))  # type: ignore[arg-type]
            except ProximityError as unusable:
                if isinstance(unusable, ImportError):
                    raise
                raise file.document.error(("model",), f"model: {unusable}") from unusable
    scene = scenes[0] if len(scenes) == 1 else joined(scenes)
    lengths = [each.report.approximation if each.report else 0.0 for each in scenes for _ in each.parts]
    approximations = dict(zip((part.name for part in scene.parts), lengths, strict=True))
    notes = [
        f"{Path(each.report.path).name}: {note}"
        for each in scenes
        if each.report
        for note in each.report.notes
    ]
    if any(lengths):
        notes.append(DEVIATION_NOTE)
    if hidden := [part.name for part in scene.parts if part.is_hidden]:
        notes.append(f"hidden parts are measured, too: {', '.join(hidden[:10])}")
    for name in hidden:
        scene.show(name)
    return _Models(scene, approximations, tuple(files), tuple(notes))


def _verify(
    file: RequirementsFile, models: _Models, requirement: Requirement, rounding: float
) -> VerifiedRequirement:
    """Verify a requirement for all its parts."""
    started, found = time.perf_counter(), []
    search = _Search(file, models.scene, requirement)
    subjects, allowed_count = search.subjects()
    try:
        with search.posed():
            for pair in subjects:
                search.check_inside(pair)
                lengths = {name: models.approximations[name] for name in pair if name}
                deviation = sum(deviation_of(models.scene, *each) for each in lengths.items())
                tolerance = max(lengths.values()) / file.settings.scale
                subject = Subject(models.scene, requirement, *pair, deviation, tolerance, rounding)
                found.append(verify_subject(subject))
    except ArgumentError as unfit:  # a pose or a motion that is too far away
        raise search.error(requirement.kind, str(unfit)) from unfit
    limits = requirement.limits
    found.sort(key=lambda each: (RANKS.index(each.verdict), limits.margin(each.lower, each.upper)))
    seconds = time.perf_counter() - started
    return VerifiedRequirement(
        requirement.name, requirement.kind, limits, tuple(found), requirement.unit, allowed_count, seconds
    )


class _Search:
    """Search of the parts of a requirement. Errors name the line and the key."""

    def __init__(self, file: RequirementsFile, scene: Scene, requirement: Requirement) -> None:
        self._document, self._scene, self._requirement = file.document, scene, requirement
        self._path: KeyPath = ("require", requirement.index)

    def error(self, key: str, sentence: str) -> ProximityError:
        """Return an error about a key of the requirement."""
        return self._document.error(
            (*self._path, key), f"require[{self._requirement.index}].{key}: {sentence}"
        )

    def _matching(self, pattern: str, key: str) -> list[str]:
        """Return the names that match a name or a pattern."""
        names = [part.name for part in self._scene.parts]
        found = [pattern] if pattern in names else [each for each in names if fnmatchcase(each, pattern)]
        if not found:
            try:
                self._scene.part(pattern)
            except SceneError as unknown:
                raise self.error(key, str(unknown)) from None
        return found

    def subjects(self) -> tuple[list[Pair], int]:
        """Return the pairs to measure, or the single parts with "", and the number of allowed pairs."""
        requirement, key = self._requirement, KINDS[self._requirement.kind].names
        groups = [self._matching(each, key) for each in requirement.between]
        if key == "part":
            return [(name, "") for name in dict.fromkeys(name for group in groups for name in group)], 0
        self._check_first(groups[0])
        pairs: dict[object, Pair] = {}
        for first, second in product(*groups):
            pair = first, second
            if first != second:
                pairs.setdefault(pair if requirement.along else frozenset(pair), pair)
        if not pairs:
            raise self.error(key, f"{groups[0][0]!r} is the only part, expected pairs of different parts")
        return self._without_allowed(list(pairs.values()))

    def _check_first(self, group: list[str]) -> None:
        """Raise an error if several parts would move."""
        for key in ("motion", "pose"):
            if getattr(self._requirement, key) is not None and len(group) > 1:
                name = self._requirement.between[0]
                raise self.error(key, f"{name!r} names {len(group)} parts, expected one that moves")

    def _without_allowed(self, pairs: list[Pair]) -> tuple[list[Pair], int]:
        """Return the pairs without the allowed ones, and the number of these."""
        left_out: set[frozenset[str]] = set()
        for first, second in self._requirement.allowed:
            groups = [self._matching(each, "allowed") for each in (first, second)]
            named = {frozenset(pair) for pair in product(*groups)}
            if not named & {frozenset(pair) for pair in pairs}:
                raise self.error("allowed", f"{first!r} and {second!r} are not a pair of this requirement")
            left_out |= named
        kept = [pair for pair in pairs if frozenset(pair) not in left_out]
        if not kept:
            raise self.error("allowed", "all pairs are allowed, expected one or more to measure")
        return kept, len(pairs) - len(kept)

    @contextmanager
    def posed(self) -> Iterator[None]:
        """Move the first part to the pose of the requirement during the block."""
        motion = self._requirement.pose
        if motion is None:
            yield
            return
        (name,) = self._matching(self._requirement.between[0], "between")
        before = self._scene.part(name).pose
        self._scene.move(name, pose_at_end(self._scene, name, motion))
        try:
            yield
        finally:
            self._scene.move(name, before)

    def check_inside(self, pair: Pair) -> None:
        """Raise an error if the verdict depends on the inside of an open part."""
        for outer, inner in (pair, pair[::-1]):
            if not outer or self._scene.part(outer).solid.has_inside:
                continue
            key = self._requirement.kind
            reason = f"part {outer!r} is not closed and has no inside"
            if not inner or self._requirement.motion is not None:
                raise self.error(key, f"{reason}, which this requirement needs")
            if key == "clash" and self._scene.clearance(outer, inner).relation is not Relation.APART:
                raise self.error(key, f"{reason}: how deep {inner!r} is in it is unknown")
            if _is_in_box(self._scene, inner, outer):
                raise self.error(key, f"{reason}: whether {inner!r} is inside it is unknown")


def _is_in_box(scene: Scene, inner: str, outer: str) -> bool:
    """Return whether the box around a part is within that of another."""
    parts = [scene.part(name) for name in (inner, outer)]
    corners = [part.pose.point(part.solid.mesh.vertices[part.solid.mesh.faces.ravel()]) for part in parts]
    lowers, uppers = [each.min(axis=0) for each in corners], [each.max(axis=0) for each in corners]
    return bool((lowers[0] >= lowers[1]).all() and (uppers[0] <= uppers[1]).all())


def _digest(name: str) -> str:
    """Return the SHA-256 of a file."""
    digest = hashlib.sha256()
    with open_regular(name) as stream:
        while block := stream.read(BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()


def _digest_of_parts(scene: Scene) -> str:
    """Return the SHA-256 of the names, poses and triangles of all parts."""
    digest = hashlib.sha256()
    for part in scene.parts:
        digest.update(f"{part.name!r} {part.solid.mesh.face_count}\n".encode())
        for array in (part.pose.matrix, part.solid.mesh.vertices, part.solid.mesh.faces):
            digest.update(np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()
