"""Parts added to and removed from a running service: a copy of its scene is changed, then takes its place.

That is done beside the loop, which goes on with the scene before; poses that are reported meanwhile reach the
new one as well.
"""

import copy
import os
from collections.abc import Callable, Sequence

from proximity.errors import ProximityError, SceneError
from proximity.scene.loader import load
from proximity.scene.part import Part
from proximity.service import Addition, Request, Service, TrackerAnswers, carry_out
from proximity.service.config import SceneFile, make_tracker, placed_parts

NOT_ALLOWED = "parts cannot be added: the scene file has no input.parts_from"


class PartChanger:
    """Carries out requests for parts to be added or removed.

    *settings*: gives the scene file as it is served at present.
    """

    def __init__(self, service: Service, settings: Callable[[], SceneFile]) -> None:
        self._service, self._settings = service, settings

    def carry_out(self, request: Request) -> None:
        """Do what a request asks for; what cannot be done is written into it."""
        try:
            self._carry_out(request)
        except ProximityError as unfit:
            request.refusal = str(unfit)
        except Exception as failure:  # a mistake of ours must not end the service
            request.refusal = f"{type(failure).__name__}: {failure}"
        finally:
            request.is_over = True

    def _carry_out(self, request: Request) -> None:
        settings, answering = self._settings(), self._service.answering
        assert isinstance(answering, TrackerAnswers), "a service with input.sensor has no parts to change"
        added = [part for each in request.additions for part in _read(each, settings.input.parts_from)]
        scene = copy.copy(answering.tracker.scene)
        for part in added:
            scene.add(part)
        carry_out(scene, request.actions)
        tracker = make_tracker(settings, scene, answering.count)
        self._service.replace(TrackerAnswers(tracker, answering.moves, answering.changes))


def allowed_file(name: str, folders: Sequence[str]) -> str:
    """Return the path of a file that a message may name: a regular file within one of some folders.

    *name*: as the message has it, relative to one of the folders. *folders*: where parts may be read from;
    the first that has the file counts.
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
