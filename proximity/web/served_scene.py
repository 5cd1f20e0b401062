"""The scene file of a service that a page feeds, and the addresses between them."""

import os
import socket
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from proximity.service.config import SceneFile, read_scene_file
from proximity.service.config.settings import FingerSettings, PartEntry

FINGERS_OF_PAGE = 10
"""Of two hands, thumb to little finger, the left hand first."""
VALID_FOR = 0.1
"""s: hands of a headset come 30 to 90 times a second, and a page in the background less often."""


class Addresses(NamedTuple):
    """Where the service publishes, and where it listens."""

    frames: str
    poses: str
    moves: str
    changes: str


def own_addresses() -> Addresses:
    """Return addresses that nobody else has: shared memory, or datagrams where there is none."""
    if find_spec("iceoryx2") is not None:
        name = f"iox2://proximity-page-{os.getpid()}-{os.urandom(4).hex()}"
        return Addresses(name, f"{name}/poses", f"{name}/moves", f"{name}/changes")
    with ExitStack() as opened:
        sockets = [opened.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in Addresses._fields]
        for each in sockets:
            each.bind(("127.0.0.1", 0))  # a port that is free
        return Addresses(*(f"udp://127.0.0.1:{each.getsockname()[1]}" for each in sockets))


def write_scene_file(
    folder: Path,
    files: Sequence[str],
    addresses: Addresses,
    *,
    units: str,
    rate_hz: float,
    radius: float | None,
) -> SceneFile:
    """Write the scene file of a service that a page feeds, and return what it says.

    *files*: of parts; or one scene file, whose parts and fingers are taken. *radius*: of all fingertips;
    None: as the scene file says, or as by default.
    """
    if len(files) == 1 and files[0].endswith(".toml"):
        given = read_scene_file(files[0])
        parts, fingers = given.parts, given.fingers
    else:
        parts = tuple(PartEntry(os.path.abspath(name), units) for name in files)
        fingers = FingerSettings()
    fingers = replace(fingers, count=fingers.count or FINGERS_OF_PAGE)
    fingers = fingers if radius is None else replace(fingers, radius=radius)
    tables: list[tuple[str, dict[str, Any]]] = [
        (
            "[service]",
            {"rate_hz": rate_hz, "valid_for": VALID_FOR, "publish": [addresses.frames], "real_time": False},
        ),
        ("[fingers]", _said(fingers)),
        ("[input]", {"poses": addresses.poses, "moves": addresses.moves, "changes": addresses.changes}),
        *(("[[parts]]", _said(part)) for part in parts),
    ]
    lines = []
    for header, content in tables:
        lines += ["", header, *(f"{key} = {_toml(value)}" for key, value in content.items())]
    path = folder / "scene.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_scene_file(path)


def _said(entry: Any) -> dict[str, Any]:
    """What of a record is not its default."""
    values = {each.name: (getattr(entry, each.name), each.default) for each in fields(entry)}
    said = {
        name: value for name, (value, default) in values.items() if value is not None and value != default
    }
    if said.get("stiffness") is not None:
        said["kind"] = "deformable"
    return said


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}" for c in escaped) + '"'
    return repr(value)
