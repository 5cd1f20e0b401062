"""Change the parts of a scene while it is served.

Messages add and remove parts, and the scene file may be edited. In both cases another scene is built while
the loop continues with the present one; then it replaces the scene between two ticks. Poses reported in
between are applied to the new scene as well.
"""

import copy
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from proximity.errors import ProximityError, SceneError
from proximity.scene.loader import load
from proximity.scene.part import Part
from proximity.service import Addition, Request, Service, TrackedContacts, carry_out
from proximity.service.config import (
    SceneFile,
    check_held,
    make_tracker,
    override,
    placed_parts,
    read_scene_file,
    stamp_of,
)
from proximity.service.config.toml_document import Path, spelled
from proximity.service.hosting.service_assembly import ServiceSetup

NOT_ALLOWED = "parts cannot be added: the scene file has no input.parts_from"
REFUSED = "the edit is refused, the previous scene stays in use"


class PartChanger:
    """Executes requests to add or remove parts.

    *settings*: function that returns the scene file served at present.
    """

    def __init__(self, service: Service, settings: Callable[[], SceneFile]) -> None:
        self._service, self._settings = service, settings

    def carry_out(self, request: Request) -> None:
        """Execute a request. If it fails, store the reason in the request."""
        try:
            self._carry_out(request)
        except ProximityError as unfit:
            request.refusal = str(unfit)
        except Exception as failure:  # a bug must not end the service
            request.refusal = f"{type(failure).__name__}: {failure}"
        finally:
            request.is_over = True

    def _carry_out(self, request: Request) -> None:
        settings, source = self._settings(), self._service.contact_source
        assert isinstance(source, TrackedContacts), "a service with input.sensor has no parts to change"
        added = [part for each in request.additions for part in _read(each, settings.input.parts_from)]
        scene = copy.copy(source.tracker.scene)
        for part in added:
            scene.add(part)
        carry_out(scene, request.actions)
        tracker = make_tracker(settings, scene, source.count)
        self._service.replace(TrackedContacts(tracker, source.moves, source.changes))


def allowed_file(name: str, folders: Sequence[str]) -> str:
    """Return the path of a file named by a message, which must be a regular file in a permitted folder.

    *name*: path relative to one of the folders. *folders*: permitted folders; the first that contains the
    file is used.
    """
    if not folders:
        raise SceneError(NOT_ALLOWED)
    if not name or "\0" in name or os.path.isabs(name):
        raise SceneError(f"the file to add is {name!r}, expected a name relative to input.parts_from")
    for folder in folders:
        path = os.path.realpath(os.path.join(folder, name))
        if not path.startswith(os.path.join(os.path.realpath(folder), "")):
            raise SceneError(f"the file to add, {name!r}, is outside of input.parts_from")
        if os.path.isfile(path):
            return path
    raise SceneError(f"the file to add, {name!r}, is not in input.parts_from")


def _read(addition: Addition, folders: Sequence[str]) -> list[Part]:
    path = allowed_file(addition.file, folders)
    parts = load(path, units=addition.units).parts
    return placed_parts(parts, addition.name, addition.pose)


class SceneReloader:
    """Reloads the scene of a running service whenever its file or a file of its parts changes.

    *made*: the service and its cache of part files. *overrides*: values that replace those of the file, also
    after edits.
    """

    def __init__(
        self, made: ServiceSetup, settings: SceneFile, overrides: dict[str, Any], say: Callable[[str], None]
    ) -> None:
        self._made, self._settings, self._overrides, self._say = made, settings, overrides, say
        self._looked_at = self._seen = _stamps(settings)

    @property
    def settings(self) -> SceneFile:
        """Settings of the scene served at present."""
        return self._settings

    def look(self) -> None:
        """Check the files for changes and apply an edit.

        A changed file is loaded only if it is unchanged since the previous check, so that it is complete.
        """
        seen = {path: stamp_of(path) for path in self._seen}
        is_finished, self._seen = seen == self._seen, seen
        if not is_finished or seen == self._looked_at:
            return
        self._looked_at = seen
        try:
            reported = self._reload()
        except ProximityError as unusable:
            reported = f"{REFUSED}: {unusable}"
        except Exception as failure:  # a bug must not end the checks
            reported = f"{REFUSED}: {type(failure).__name__}: {failure}"
        self._say(reported)

    def _reload(self) -> str:
        """Build the edited scene and pass it to the loop. Return a sentence that reports it."""
        started, before = time.monotonic(), self._settings
        settings = override(read_scene_file(before.path), self._overrides)
        # New files are watched as well from here on, even if they cannot be used yet.
        self._seen = self._looked_at = {**_stamps(settings), **self._looked_at}
        refuse_what_needs_a_restart(before, settings)
        if self._made.scene is None:
            return f"{settings.path} was edited without effect"
        scene = self._made.files.scene(settings)
        check_held(settings, scene)
        tracker = make_tracker(settings, scene, self._made.count)
        self._made.service.replace(TrackedContacts(tracker, self._made.moves, self._made.changes))
        self._settings = settings
        self._seen = self._looked_at = {path: self._looked_at[path] for path in _stamps(settings)}
        return f"{settings.path} was edited: {scene} is in use, after {time.monotonic() - started:.1f} s"


def refuse_what_needs_a_restart(before: SceneFile, after: SceneFile) -> None:
    """Raise an error if the edited file changes a setting that is fixed in a running service."""
    reported = _fixed(after)
    for path, value in _fixed(before).items():
        if reported[path] != value:
            raise after.error(path, f"{spelled(path)} was changed: restart the service to apply it")


def _fixed(settings: SceneFile) -> dict[Path, Any]:
    """Return the settings that are fixed in a running service, by their paths."""
    reported: dict[Path, Any] = {("service", key): value for key, value in asdict(settings.service).items()}
    del reported["service", "latency"]
    reported["fingers", "count"] = settings.fingers.count
    reported["fingers", "names"] = settings.fingers.names
    source = asdict(settings.input)
    recorded = source.pop("recording") or {}
    source["recording"] = recorded.pop("file", None)
    reported |= {("input", key): value for key, value in {**source, **recorded}.items()}
    reported["glove",] = settings.glove
    reported["held",] = settings.held
    return reported


def _stamps(settings: SceneFile) -> dict[str, Any]:
    return {path: stamp_of(path) for path in (settings.path, *(part.file for part in settings.parts))}
