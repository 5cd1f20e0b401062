"""Scene file of a service, which names its parts, fingers, source of poses and addresses of frames.

A scene file is written in TOML; every error names the line. ``meshes/demo.toml`` explains each key.
`read_scene_file` validates the file without opening its parts; the objects are then built from the settings.
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
