"""A page started from Python: in a process of its own, with the service in another."""

import os
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from proximity.errors import ServiceError
from proximity.scene.scene import Scene
from proximity.service.hosting import RunningService
from proximity.service.hosting.process import STOP_TIMEOUT

BEGIN_TIMEOUT = 600.0
"""s. Large parts may have to be read, and once kernels compiled."""


class RunningPage(RunningService):
    """A page that can be opened at ``url``; made by `view`, ended by ``stop()`` or with this process.

    At the end of a notebook's cell it is shown below it.

    Parameters
    ----------
    words : sequence of str
        What ``proximity view`` is given.
    name : str
        What is shown, for messages.
    say : callable
        Is given what the page's process says meanwhile, by another thread.
    height : int
        Of the frame in a notebook, in pixels.
    folder : TemporaryDirectory
        Of what is shown; it goes with this object.
    """

    def __init__(
        self,
        words: Sequence[str],
        name: str,
        say: Callable[[str], None],
        *,
        height: int = 600,
        folder: tempfile.TemporaryDirectory[str] | None = None,
    ) -> None:
        command = [sys.executable, "-P", "-m", "proximity", "view", *words]
        command += ["--no-browser", "--json", "--until-stdin"]
        super().__init__(command, name, say, BEGIN_TIMEOUT)
        self._height, self._folder = height, folder

    @property
    def url(self) -> str:
        """Where the page is, with the token that lets one in."""
        return str(self.beginning["url"])

    def stop(self, timeout: float = STOP_TIMEOUT) -> dict[str, Any]:
        """End the page, its bridge and the service behind it; stopping twice is once.

        Parameters
        ----------
        timeout : float, s
            How long to wait; then it is killed.

        Returns
        -------
        dict
            ``refused``: how often a page or a request was refused, by what was wrong.
        """
        try:
            return super().stop(timeout)
        finally:
            if self._folder is not None:
                self._folder.cleanup()

    def _repr_html_(self) -> str:
        return (
            f'<iframe src="{self.url}" style="width: 100%; height: {self._height}px; border: 0" '
            'allow="xr-spatial-tracking; fullscreen"></iframe>'
        )

    def __repr__(self) -> str:
        return f"RunningPage({self.url!r})" if self.is_running else "RunningPage(ended)"


def view(
    scene: Scene | str | os.PathLike[str], *, open_browser: bool | None = None, height: int = 600
) -> RunningPage:
    """Show a scene in the browser, with hands over it and their distances.

    Parameters
    ----------
    scene : Scene, or path
        What is shown: a scene as it is now, a file of parts, or a scene file. What is changed of a `Scene`
        later is not seen.
    open_browser : bool
        Whether a browser is opened. Where not given: unless this is a notebook, which shows the page below
        the cell.
    height : int
        Of the frame in a notebook, in pixels.

    Returns
    -------
    RunningPage
        Its ``url`` can be opened; ``stop()`` ends it, and so does the end of this process.

    Raises
    ------
    ServiceError
        If it cannot be shown, with the sentence that says why.
    """
    if isinstance(scene, Scene):
        folder = tempfile.TemporaryDirectory(prefix="proximity-view-", ignore_cleanup_errors=True)
        path = Path(folder.name) / "scene.prox"
        scene.save(path)
        page = RunningPage([str(path), "--framed"], "the scene", print, height=height, folder=folder)
    elif isinstance(scene, str | os.PathLike):
        name = os.fsdecode(scene)
        page = RunningPage([name, "--framed"], name, print, height=height)
    else:
        raise ServiceError(f"a page shows a Scene or a file, not {type(scene).__name__}")
    if open_browser is None:
        open_browser = "ipykernel" not in sys.modules
    if open_browser:
        webbrowser.open(page.url)
    return page
