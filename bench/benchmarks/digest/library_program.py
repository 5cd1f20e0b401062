"""Scenes answered by a program linked with the library: for emulated processors and systems.

The program is ``tests/support/clients/library_server.c``, which reads queries from its standard input.
"""

import struct
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.digest.library import ERRORS, WIDTHS, LibraryScene
from proximity import ProximityError, Scene

QUESTIONS = (
    "closest", "signed_distance", "distance", "contains", "cast", "cast_distance", "closest_to_segments"
)  # fmt: skip
HEAD, CODE = struct.Struct("<qqd"), struct.Struct("<q")


class ProgramScene(LibraryScene):
    """A compiled scene opened by another program."""

    def __init__(self, command: list[str], path: Path) -> None:
        self._program = subprocess.Popen(
            [*command, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )

    def close(self) -> None:
        """End the program."""
        self._program.communicate()

    __del__ = close

    def _ask(
        self, name: str, *given: Any, ignore: Any = None, limit: Any = None, dtype: type = np.float64
    ) -> np.ndarray:
        assert ignore is None, "programs are not told to ignore parts"
        rows = [np.array(each, np.float64, order="C") for each in given]
        table = np.empty((*rows[0].shape[:-1], WIDTHS.get(name, 1)), dtype)
        assert self._program.stdin is not None and self._program.stdout is not None
        head = HEAD.pack(QUESTIONS.index(name), rows[0].size // 3, np.inf if limit is None else limit)
        self._program.stdin.write(head + b"".join(each.tobytes() for each in rows))
        self._program.stdin.flush()
        (code,) = CODE.unpack(self._program.stdout.read(CODE.size))
        answers = self._program.stdout.read(table.nbytes)
        if code:
            raise ERRORS.get(code, ProximityError)(f"the program says {code}")
        return np.frombuffer(answers, dtype).reshape(table.shape).copy()


def through_program(scene: Scene, command: list[str]) -> ProgramScene:
    """Return a scene, saved, and opened by the program of a command."""
    with tempfile.TemporaryDirectory(prefix="proximity_digest_") as folder:
        path = Path(folder) / "scene.prox"
        scene.save(path)
        opened = ProgramScene(command, path)
        opened.distance(np.zeros((1, 3)))  # it has opened the file
        return opened
