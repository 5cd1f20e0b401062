"""Reload a scene file that is edited while it is served: built beside the loop, taken between two ticks.

What cannot be used is said, and the scene before goes on.
"""

import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from proximity.errors import ProximityError
from proximity.service import TrackerAnswers
from proximity.service.config import SceneFile, make_tracker, override, read_scene_file, stamp_of
from proximity.service.config.toml_document import Path, spelled
from proximity.service.hosting.service_assembly import Made

REFUSED = "the edit is refused, the previous scene stays in use"


class SceneReloader:
    """Gives a running service the scene of its file, whenever that file or a file of its parts changes.

    *made*: the service, and what is kept of its scene. *overrides*: what was said otherwise than in the file:
    it goes on to hold.
    """

    def __init__(
        self, made: Made, settings: SceneFile, overrides: dict[str, Any], say: Callable[[str], None]
    ) -> None:
        self._made, self._settings, self._overrides, self._say = made, settings, overrides, say
        self._looked_at = self._seen = _stamps(settings)

    @property
    def settings(self) -> SceneFile:
        """The scene file as it is served at present."""
        return self._settings

    def look(self) -> None:
        """Take an edit, if there is one that the look before has seen already: it is not half-written."""
        seen = {path: stamp_of(path) for path in self._seen}
        is_finished, self._seen = seen == self._seen, seen
        if not is_finished or seen == self._looked_at:
            return
        self._looked_at = seen
        try:
            reported = self._take()
        except ProximityError as unusable:
            reported = f"{REFUSED}: {unusable}"
        except Exception as failure:  # a mistake of ours must not end the looking
            reported = f"{REFUSED}: {type(failure).__name__}: {failure}"
        self._say(reported)

    def _take(self) -> str:
        """Make the edited scene and hand it to the loop; what is said of it."""
        started, before = time.monotonic(), self._settings
        settings = override(read_scene_file(before.path), self._overrides)
        # Files that are new are watched as well from here on, even if they cannot be used yet.
        self._seen = self._looked_at = {**_stamps(settings), **self._looked_at}
        refuse_what_needs_a_restart(before, settings)
        if self._made.scene is None:
            return f"{settings.path} was edited without effect"
        scene = self._made.files.scene(settings)
        tracker = make_tracker(settings, scene, self._made.count)
        self._made.service.replace(TrackerAnswers(tracker, self._made.moves, self._made.changes))
        self._settings = settings
        self._seen = self._looked_at = {path: self._looked_at[path] for path in _stamps(settings)}
        return f"{settings.path} was edited: {scene} is in use, after {time.monotonic() - started:.1f} s"


def refuse_what_needs_a_restart(before: SceneFile, after: SceneFile) -> None:
    """Raise if a file says something else of what a running service cannot change."""
    reported = _fixed(after)
    for path, value in _fixed(before).items():
        if reported[path] != value:
            raise after.error(path, f"{spelled(path)} was changed: restart the service to apply it")


def _fixed(settings: SceneFile) -> dict[Path, Any]:
    """Settings that a running service cannot change, by where they stand."""
    reported: dict[Path, Any] = {("service", key): value for key, value in asdict(settings.service).items()}
    del reported["service", "latency"]
    reported["fingers", "count"] = settings.fingers.count
    reported["fingers", "names"] = settings.fingers.names
    source = asdict(settings.input)
    recorded = source.pop("recording") or {}
    source["recording"] = recorded.pop("file", None)
    reported |= {("input", key): value for key, value in {**source, **recorded}.items()}
    reported["glove",] = settings.glove
    return reported


def _stamps(settings: SceneFile) -> dict[str, Any]:
    return {path: stamp_of(path) for path in (settings.path, *(part.file for part in settings.parts))}
