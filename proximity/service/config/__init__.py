"""The scene file of a service: parts, fingers, the source of poses and the addresses of frames.

TOML, with every mistake named by its line; ``meshes/demo.toml`` explains each key. `read_scene_file` checks
what can be checked without opening parts; what the file describes is then made of it.
"""

from proximity.service.config.scene_builder import (
    PartFiles,
    finger_count,
    finger_names,
    finger_radii,
    make_tracker,
    place_recording,
    placed_parts,
    read_input,
    stamp_of,
)
from proximity.service.config.scene_file_reader import check_held, override, read_scene_file
from proximity.service.config.settings import (
    FingerSettings,
    GloveSettings,
    HeldEntry,
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
    "HeldEntry",
    "InputSettings",
    "PartEntry",
    "PartFiles",
    "RecordingEntry",
    "SceneFile",
    "ServiceSettings",
    "WebSettings",
    "check_held",
    "finger_count",
    "finger_names",
    "finger_radii",
    "make_tracker",
    "override",
    "place_recording",
    "placed_parts",
    "read_input",
    "read_scene_file",
    "stamp_of",
]
