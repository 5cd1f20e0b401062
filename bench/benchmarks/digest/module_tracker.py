"""A tracker in a program with the engine for browsers, on the scene of a trial, to check its bounds.

The program is ``tests/support/clients/module_server.mjs``. Moves, hiding and showing of parts are forwarded;
when parts are added, removed or deformed, it opens the scene again.
"""

import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.digest.library_program import CODE, HEAD
from proximity import Pose, Scene, Tracker
from proximity.message import CONTACT

BEGIN, OPEN, MOVE, HIDE, RESET, TICK = range(20, 26)
SETTINGS = "latency", "working_range", "tolerance", "horizon", "max_speed", "max_acceleration", "budget"


class ForwardedScene:
    """A scene whose changes are forwarded to a program."""

    def __init__(self, scene: Scene, command: list[str]) -> None:
        self.scene, self.is_other = scene, False
        self._folder = tempfile.TemporaryDirectory(prefix="proximity_trial_")
        self._path = Path(self._folder.name, "scene.prox")
        self._save()
        self._program = subprocess.Popen(
            [*command, str(self._path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def _save(self) -> None:
        self.scene.save(self._path)
        self._numbers = {part.name: number for number, part in enumerate(self.scene.parts)}

    def close(self) -> None:
        """End the program."""
        self._program.communicate()
        self._folder.cleanup()

    def tell(self, action: int, words: np.ndarray, size: int = 0) -> bytes:
        """Send the program an action; return *size* bytes of its answer."""
        assert self._program.stdin is not None and self._program.stdout is not None
        self._program.stdin.write(HEAD.pack(action, len(words), 0.0) + words.tobytes())
        self._program.stdin.flush()
        (code,) = CODE.unpack(self._program.stdout.read(CODE.size))
        assert code == 0
        return self._program.stdout.read(size)

    def refresh(self) -> bool:
        """Make the program open the present scene, if it has another; return whether it did."""
        was_other, self.is_other = self.is_other, False
        if was_other:
            self._save()
            self.tell(OPEN, np.zeros(0))
        return was_other

    def move(self, name: str, pose: Any, *, velocity: Any, angular_velocity: Any) -> None:
        """Like `Scene.move`."""
        self.scene.move(name, pose, velocity=velocity, angular_velocity=angular_velocity)
        self._tell_moves([name], [pose], [velocity], [angular_velocity])

    def move_many(self, names: list[str], poses: Any, velocities: Any, spins: Any) -> None:
        """Like `Scene.move_many`."""
        self.scene.move_many(names, poses, velocities, spins)
        self._tell_moves(names, poses, velocities, spins)

    def _tell_moves(self, names: list[str], poses: Any, velocities: Any, spins: Any) -> None:
        if not self.is_other:
            numbers = [[self._numbers[name]] for name in names]
            matrices = [Pose.of(pose).matrix.ravel() for pose in poses]
            rows = np.concatenate([numbers, matrices, velocities, spins], axis=1)
            self.tell(MOVE, rows.astype(np.float64).ravel())

    def hide(self, name: str, *, is_hidden: bool = True) -> None:
        """Like `Scene.hide`."""
        (self.scene.hide if is_hidden else self.scene.show)(name)
        if not self.is_other:
            self.tell(HIDE, np.array([self._numbers[name], is_hidden], np.float64))

    def show(self, name: str) -> None:
        """Like `Scene.show`."""
        self.hide(name, is_hidden=False)

    def __getattr__(self, name: str) -> Any:
        if name in ("add", "remove", "deform"):
            self.is_other = True
        return getattr(self.scene, name)


class ModuleTracker:
    """A tracker of the engine for browsers, with the methods of `Tracker` used by trials."""

    def __init__(self, scene: ForwardedScene, fingers: int, **given: Any) -> None:
        self._scene, self._twin = scene, Tracker(scene.scene, fingers=fingers, **given)
        self.fingers = fingers
        settings = [np.nan if given.get(name) is None else float(given[name]) for name in SETTINGS]
        radii = np.broadcast_to(given["radius"], fingers)
        scene.tell(BEGIN, np.array([*settings, *radii]))

    @property
    def _settings(self) -> Any:
        if self._scene.refresh():
            self._twin.reset()  # like the tracker, which restarts on a newly opened scene
        return self._twin._settings

    def reset(self) -> None:
        """Like `Tracker.reset`."""
        self._twin.reset()
        self._scene.tell(RESET, np.zeros(0))

    def tick(self, positions: np.ndarray, pose_ns: Any, now_ns: int, **known: Any) -> np.ndarray:
        """Like `Tracker.tick`; the twin, ticked first, gives the permitted coarseness for crowds."""
        self._twin.tick(positions, pose_ns, now_ns, **known)
        names = "velocities", "paths", "path_bends", "bends"
        more = [np.zeros(0) if known.get(name) is None else np.ravel(known[name]) for name in names]
        head = np.array([now_ns], np.int64).view(np.float64)
        instants = np.broadcast_to(np.asarray(pose_ns, np.int64), self.fingers).copy().view(np.float64)
        sizes = [float(len(each)) for each in more]
        words = np.concatenate([head, sizes, instants, positions.ravel(), *more])
        return np.frombuffer(self._scene.tell(TICK, words, self.fingers * CONTACT.itemsize), CONTACT)
