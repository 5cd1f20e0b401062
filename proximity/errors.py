"""The exceptions of the package, as a tree, with remedies.

::

    ProximityError
    ├── MeshError          (ValueError)    choose another mesh, or repair it
    │   ├── MeshFormatError                export the file again: it is damaged, or of another format
    │   │   └── FileVersionError           compile the scene again: another version saved it
    │   └── NotWatertightError             use unsigned distances, or close the surface
    ├── ArgumentError      (ValueError)    change the argument that the message names
    │   └── PoseError                      give a rotation and a translation
    ├── FileError          (OSError)       write to another path, or make room there
    ├── MissingLibraryError (ImportError)  install what the message names
    ├── SceneError         (ValueError)    name existing parts; save under another name
    ├── RecordingError     (ValueError)    choose another recording or log
    ├── ServiceError       (ValueError)    correct the line of the scene file that the message names
    ├── DecaffError        (ValueError)    correct the glove's file, or measure again
    ├── PublishError       (OSError)       choose another address, or try again
    └── MotorError         (RuntimeError)  inspect the motor before it gets power again
    UnitsWarning           (UserWarning)   give positions in metres; can be filtered

A message states the cause, the place and the expected value. Bad input raises; a missing answer never does.
"""


class ProximityError(Exception):
    """Base of every error that this package raises on purpose."""


class MeshError(ProximityError, ValueError):
    """The mesh cannot be used."""


class MeshFormatError(MeshError):
    """The file is not of its declared format, or could not be read completely."""


class FileVersionError(MeshFormatError):
    """A compiled scene is of another version."""


class NotWatertightError(MeshError):
    """A sign was requested of a surface that has no inside."""


class ArgumentError(ProximityError, ValueError):
    """An argument cannot be used."""


class PoseError(ArgumentError):
    """Not a rigid transform."""


class FileError(ProximityError, OSError):
    """A file cannot be written."""


class MissingLibraryError(ProximityError, ImportError):
    """An optional library is not installed, or cannot be imported."""


class SceneError(ProximityError, ValueError):
    """The parts of a scene contradict each other, a part does not exist, or a scene cannot be saved."""


class RecordingError(ProximityError, ValueError):
    """A recording cannot be read or used, or a log of contacts not written."""


class PublishError(ProximityError, OSError):
    """An address cannot be opened, or a message not be published or received there."""


class ServiceError(ProximityError, ValueError):
    """A scene file cannot be used, or a service cannot be run as described."""


class DecaffError(ProximityError, ValueError):
    """A model, a calibration or a controller cannot be used as described."""


class MotorError(ProximityError, RuntimeError):
    """A motor cannot be used as described, or was switched off because its state was uncertain."""


class UnitsWarning(UserWarning):
    """Points are far enough from a scene to be in millimetres."""
