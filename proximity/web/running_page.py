"""Start a page from Python in a separate process."""

import os
import socket
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from proximity.errors import ServiceError
from proximity.scene.scene import Scene
from proximity.service.hosting import RunningService
from proximity.service.hosting.process import STOP_TIMEOUT
from proximity.web.server.access import open_in_browser

BEGIN_TIMEOUT = 600.0
"""Maximum wait until the page can be opened, s. Large parts may have to be read, and kernels compiled
once."""


class Addresses(NamedTuple):
    """Addresses of a service, which are those of its outputs and its inputs."""

    frames: str
    poses: str
    moves: str
    changes: str


def own_addresses() -> Addresses:
    """Return unused addresses of shared memory, or of datagrams if that is not supported."""
    if sys.platform == "linux":
        name = f"shm://proximity-page-{os.getpid()}-{os.urandom(4).hex()}"
        return Addresses(name, f"{name}/poses", f"{name}/moves", f"{name}/changes")
    with ExitStack() as opened:
        sockets = [opened.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in Addresses._fields]
        for each in sockets:
            each.bind(("127.0.0.1", 0))  # a free port
        return Addresses(*(f"udp://127.0.0.1:{each.getsockname()[1]}" for each in sockets))


class RunningPage(RunningService):
    """A page that can be opened at ``url``.

    It is created by `view` and ends by ``stop()`` or with this process. As the last value of a notebook's
    cell, it is shown below the cell.

    Parameters
    ----------
    words : sequence of str
        Arguments of ``proximity view``.
    name : str
        Name of the content, for messages.
    say : callable
        Called with the messages of the page's process, by another thread.
    height : int
        Height of the frame in a notebook, in pixels.
    folder : TemporaryDirectory
        Folder of temporary files, removed with this object.
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
        """Address of the page, with the token that it requires."""
        return str(self.beginning["url"])

    def stop(self, timeout: float = STOP_TIMEOUT) -> dict[str, Any]:
        """Stop the page and its service. Stopping again has no effect.

        Parameters
        ----------
        timeout : float, s
            Longest wait; then the process is killed.

        Returns
        -------
        dict
            ``refused``: how often pages and requests were refused, by reason.
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
    """Show a scene in the browser, with hands and the distances of their fingertips.

    Parameters
    ----------
    scene : Scene, or path
        A scene, a file of parts, or a scene file. Later changes of a `Scene` are not shown.
    open_browser : bool
        Whether to open a browser. Default: yes, except in a notebook, which shows the page below the cell.
    height : int
        Height of the frame in a notebook, in pixels.

    Returns
    -------
    RunningPage
        Its ``url`` can be opened; ``stop()`` or the end of this process ends it.

    Raises
    ------
    ServiceError
        If it cannot be shown; the message says why.
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
        open_in_browser(page.url)
    return page
