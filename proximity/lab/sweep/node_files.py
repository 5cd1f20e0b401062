"""Files of a study on the node where a job runs: scenes compiled once a node and mapped, recordings, output.

Jobs of one node share the memory of a compiled scene. All nodes see the study's folder under one path.
"""

import contextlib
import hashlib
import os
import stat
import tempfile
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import proximity
from proximity.errors import MeshFormatError, ServiceError
from proximity.recording import Recording, read_recording
from proximity.scene.loader import load
from proximity.scene.scene import Scene
from proximity.system.machine import commit

try:
    import fcntl
except ImportError:  # not a POSIX system: a scene may be compiled twice there
    fcntl = None  # type: ignore[assignment]

SCENES_KEPT = 2
"""Scenes that one process has open; conditions with one scene follow each other."""
LARGEST_CACHE_BYTES = 16 << 30
"""Of compiled scenes on a node; the ones used longest ago go first."""

_open_scenes: OrderedDict[tuple[str, str], Scene] = OrderedDict()


def file_digest(path: str) -> str:
    """Return the SHA-256 of a file, 64 hexadecimal digits: two files of equal content have one."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True, slots=True)
class NodeFiles:
    """Files of one condition."""

    folder: str  # that paths in the study file start from
    out: str  # results of the study
    key: str  # of the condition
    digests: Mapping[str, str]  # by factor

    def scene(self, name: str, units: str) -> Scene:
        """Return the scene that the factor "scene" names, mapped from what this node has compiled."""
        wanted = (self.digests["scene"], units)
        if wanted not in _open_scenes:
            while len(_open_scenes) >= SCENES_KEPT:
                _open_scenes.popitem(last=False)
            _open_scenes[wanted] = _compiled(os.path.join(self.folder, name), *wanted)
        _open_scenes.move_to_end(wanted)
        return _open_scenes[wanted]

    def recording(self, name: str) -> Recording:
        """Return the recording that the factor "recording" names."""
        return _recording(os.path.join(self.folder, name), self.digests["recording"])

    def output(self, suffix: str) -> Path:
        """Return where the job may write a file of this condition; its folder is there."""
        folder = Path(self.out, "files")
        folder.mkdir(parents=True, exist_ok=True)
        return folder / f"{self.key}{suffix}"


def _compiled(path: str, digest: str, units: str) -> Scene:
    compiled = _cache_folder() / f"{digest}-{units}-{proximity.__version__}-{commit().split()[0]}.prox"
    with _locked(compiled):
        if compiled.exists():
            with contextlib.suppress(MeshFormatError):  # damaged, or removed just now: made again
                scene = load(compiled)
                os.utime(compiled)
                return scene
        _check_unchanged(path, digest)
        load(path, units=units).save(compiled)
        _limit_cache(compiled)
        return load(compiled)


@lru_cache(maxsize=4)
def _recording(path: str, digest: str) -> Recording:
    _check_unchanged(path, digest)
    return read_recording(path)


def _check_unchanged(path: str, digest: str) -> None:
    try:
        found = file_digest(path)
    except OSError as failed:
        raise ServiceError(f"{path}: cannot be read ({failed.strerror}) where the job runs") from failed
    if found != digest:
        raise ServiceError(f"{path}: has changed since the study began, run the study again")


def _cache_folder() -> Path:
    user = getattr(os, "getuid", lambda: 0)()
    folder = Path(tempfile.gettempdir(), f"proximity-scenes-{user}")
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    status = folder.lstat()  # a link is no folder of ours, wherever it leads
    if status.st_uid != user:
        raise ServiceError(f"{folder}: belongs to another user, expected a folder of compiled scenes")
    if not stat.S_ISDIR(status.st_mode) or (os.name != "nt" and status.st_mode & 0o077):
        raise ServiceError(f"{folder}: is no folder, or others may use it, expected one with mode 0700")
    return folder


@contextlib.contextmanager
def _locked(compiled: Path) -> Iterator[None]:
    """Let one process of this node at a time open or make a compiled scene."""
    with open(compiled.with_suffix(".lock"), "ab") as lock:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _limit_cache(newest: Path) -> None:
    sizes = {}
    for path in newest.parent.glob("*.prox"):
        with contextlib.suppress(FileNotFoundError):  # another process was here first
            sizes[path] = path.stat()
    total = sum(status.st_size for status in sizes.values())
    for path in sorted(sizes, key=lambda path: sizes[path].st_mtime):
        if total <= LARGEST_CACHE_BYTES:
            break
        if path != newest:
            path.unlink(missing_ok=True)
            total -= sizes[path].st_size
