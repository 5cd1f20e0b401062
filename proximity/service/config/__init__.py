"""A service described in a file: which parts, which fingers, where poses come from, where frames go.

TOML, with every mistake named by its line; ``meshes/demo.toml`` explains each key. `read_scene_file` checks
what can be checked without opening parts; what the file describes is then made of it.
"""

from proximity.service.config.builder import (
    PartFiles,
    finger_count,
    make_tracker,
    place_recording,
    read_input,
    stamp_of,
)
from proximity.service.config.reader import override, read_scene_file
from proximity.service.config.settings import (
    FingerSettings,
    GloveSettings,
    InputSettings,
    PartEntry,
    RecordingEntry,
    SceneFile,
    ServiceSettings,
    WebSettings,
)

__all__ = [
    "FingerSettings",
    "GloveSettings",
    "InputSettings",
    "PartEntry",
    "PartFiles",
    "RecordingEntry",
    "SceneFile",
    "ServiceSettings",
    "WebSettings",
    "finger_count",
    "make_tracker",
    "override",
    "place_recording",
    "read_input",
    "read_scene_file",
    "stamp_of",
]
