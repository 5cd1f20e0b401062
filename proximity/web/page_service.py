"""The service of a page: a loop in a thread of the page's process, on the scene that the page shows."""

import gc
import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from proximity.errors import ProximityError
from proximity.service.config import (
    FingerSettings,
    InputSettings,
    PartEntry,
    SceneFile,
    ServiceSettings,
    WebSettings,
    read_scene_file,
)
from proximity.service.config.toml_document import Document
from proximity.service.hosting.service_assembly import make_service

FINGERS_OF_PAGE = 10
"""Of two hands, thumb to little finger, the left hand first."""
VALID_FOR = 0.1
"""s: hands of a headset come 30 to 90 times a second, and a page in the background less often."""
LOOK_S = 0.005
"""Between two looks whether the first frame is out."""


def page_settings(files: Sequence[str], *, units: str, rate_hz: float, radius: float | None) -> SceneFile:
    """Return settings for parts that a page shows and feeds; *radius* None: as the scene file says.

    *files*: of parts; or one scene file, whose parts and fingers are taken.
    """
    if len(files) == 1 and files[0].endswith(".toml"):
        given = read_scene_file(files[0])
    else:
        parts = tuple(PartEntry(os.path.abspath(name), units) for name in files)
        nothing = ServiceSettings(), FingerSettings(), parts, InputSettings(), None, WebSettings()
        given = SceneFile("", *nothing, Document("", ""))
    fingers = replace(given.fingers, count=given.fingers.count or FINGERS_OF_PAGE)
    address = f"mailbox:page-{os.getpid()}-{os.urandom(4).hex()}"
    return replace(
        given,
        service=ServiceSettings(rate_hz, valid_for=VALID_FOR, publish=(address,)),
        fingers=fingers if radius is None else replace(fingers, radius=radius),
        input=InputSettings(poses=f"{address}/poses"),
        glove=None,
    )


class PageService:
    """A service that runs from the start of a ``with`` block to its end."""

    failure: BaseException | None = None
    """Why it ended before its time."""

    def __init__(self, settings: SceneFile, report: Callable[[str], None]) -> None:
        self._setup, self._report = make_service(settings), report
        assert self._setup.scene is not None, "a page's service has parts"
        self.scene, self.finger_count = self._setup.scene, self._setup.count
        self.notes = self._setup.files.notes
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="service of the page", daemon=True)

    def __enter__(self) -> "PageService":
        self._thread.start()
        service = self._setup.service
        while self._thread.is_alive() and not service.report.ticks:
            time.sleep(LOOK_S)
        # The loop leaves no cycles, the page does; what was there before is frozen, so this takes no time.
        gc.enable()
        return self

    def __exit__(self, *unused: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            self._setup.service.run(stop=self._over)
        except BaseException as failure:  # a thread that ends is noticed by nobody else
            self.failure = failure
            if isinstance(failure, ProximityError):
                self._report(str(failure))
