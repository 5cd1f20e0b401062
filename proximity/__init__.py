"""Exact distance from points, rays and segments to CAD parts.

>>> import proximity
>>> scene = proximity.load("bracket.stl")
>>> hit = scene.closest([0.03, 0.01, 0.005])
>>> hit.signed_distance, hit.point, hit.gradient

Metres everywhere; signed distance is negative inside. The names below are all there is for users. They are
imported when first asked for: ``import proximity`` alone takes milliseconds, and compiles nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from proximity.errors import (
        DecaffError,
        MeshError,
        MeshFormatError,
        MotorError,
        NotWatertightError,
        PoseError,
        ProximityError,
        PublishError,
        QueryError,
        RecordingError,
        SceneError,
        ServiceError,
        UnitsWarning,
    )
    from proximity.mesh.triangle_mesh import TriangleMesh
    from proximity.message import (
        ADDITIONS,
        CHANGES,
        CONTACT,
        DEFORMATIONS,
        FRAME,
        GLOVE_POSES,
        MEASURED,
        MOVES,
        PATH_POSES,
        POSES,
        ContactFlag,
        Message,
        Mode,
        PartAction,
        Source,
        State,
        Surface,
    )
    from proximity.pose import Pose
    from proximity.scene.clearance import Clearance, clearance
    from proximity.scene.load_report import LoadReport
    from proximity.scene.loader import load
    from proximity.scene.overlap import Overlap, overlap
    from proximity.scene.part import Part
    from proximity.scene.queries.results import NO_FACE, NO_PART, ClosestPoints, Feature, RayHits, SegmentHits
    from proximity.scene.scene import Scene
    from proximity.scene.sign import SignMethod
    from proximity.scene.solid import Solid
    from proximity.scene.trimesh_scene import from_trimesh
    from proximity.service.hosting import RunningService, serve, start_service
    from proximity.tracker.tracker import Tracker
    from proximity.tracker.warm_up import kernels_are_cached, warm_up
    from proximity.transport import Publisher, Reading, Subscriber, open_publisher, open_subscriber
    from proximity.web import RunningPage, view

__version__ = "0.1.0"

__all__ = [
    "ADDITIONS",
    "CHANGES",
    "CONTACT",
    "DEFORMATIONS",
    "FRAME",
    "GLOVE_POSES",
    "MEASURED",
    "MOVES",
    "NO_FACE",
    "NO_PART",
    "PATH_POSES",
    "POSES",
    "Clearance",
    "ClosestPoints",
    "ContactFlag",
    "DecaffError",
    "Feature",
    "LoadReport",
    "MeshError",
    "MeshFormatError",
    "Message",
    "Mode",
    "MotorError",
    "NotWatertightError",
    "Overlap",
    "Part",
    "PartAction",
    "Pose",
    "PoseError",
    "ProximityError",
    "PublishError",
    "Publisher",
    "QueryError",
    "RayHits",
    "Reading",
    "RecordingError",
    "RunningPage",
    "RunningService",
    "Scene",
    "SceneError",
    "SegmentHits",
    "ServiceError",
    "SignMethod",
    "Solid",
    "Source",
    "State",
    "Subscriber",
    "Surface",
    "Tracker",
    "TriangleMesh",
    "UnitsWarning",
    "clearance",
    "from_trimesh",
    "kernels_are_cached",
    "load",
    "open_publisher",
    "open_subscriber",
    "overlap",
    "serve",
    "start_service",
    "view",
    "warm_up",
]

_MODULE_OF = {
    "ADDITIONS": "proximity.message",
    "CHANGES": "proximity.message",
    "CONTACT": "proximity.message",
    "DEFORMATIONS": "proximity.message",
    "FRAME": "proximity.message",
    "GLOVE_POSES": "proximity.message",
    "MEASURED": "proximity.message",
    "MOVES": "proximity.message",
    "NO_FACE": "proximity.scene.queries.results",
    "NO_PART": "proximity.scene.queries.results",
    "PATH_POSES": "proximity.message",
    "POSES": "proximity.message",
    "Clearance": "proximity.scene.clearance",
    "clearance": "proximity.scene.clearance",
    "ClosestPoints": "proximity.scene.queries.results",
    "ContactFlag": "proximity.message",
    "DecaffError": "proximity.errors",
    "Feature": "proximity.scene.queries.results",
    "LoadReport": "proximity.scene.load_report",
    "MeshError": "proximity.errors",
    "MeshFormatError": "proximity.errors",
    "MotorError": "proximity.errors",
    "Message": "proximity.message",
    "Mode": "proximity.message",
    "NotWatertightError": "proximity.errors",
    "Overlap": "proximity.scene.overlap",
    "overlap": "proximity.scene.overlap",
    "Part": "proximity.scene.part",
    "PartAction": "proximity.message",
    "Pose": "proximity.pose",
    "PoseError": "proximity.errors",
    "ProximityError": "proximity.errors",
    "PublishError": "proximity.errors",
    "Publisher": "proximity.transport",
    "QueryError": "proximity.errors",
    "RayHits": "proximity.scene.queries.results",
    "Reading": "proximity.transport",
    "RecordingError": "proximity.errors",
    "RunningPage": "proximity.web",
    "RunningService": "proximity.service.hosting",
    "Scene": "proximity.scene.scene",
    "SceneError": "proximity.errors",
    "SegmentHits": "proximity.scene.queries.results",
    "ServiceError": "proximity.errors",
    "SignMethod": "proximity.scene.sign",
    "Solid": "proximity.scene.solid",
    "Source": "proximity.message",
    "State": "proximity.message",
    "Subscriber": "proximity.transport",
    "Surface": "proximity.message",
    "Tracker": "proximity.tracker.tracker",
    "TriangleMesh": "proximity.mesh.triangle_mesh",
    "UnitsWarning": "proximity.errors",
    "from_trimesh": "proximity.scene.trimesh_scene",
    "kernels_are_cached": "proximity.tracker.warm_up",
    "load": "proximity.scene.loader",
    "open_publisher": "proximity.transport",
    "open_subscriber": "proximity.transport",
    "serve": "proximity.service.hosting",
    "start_service": "proximity.service.hosting",
    "view": "proximity.web",
    "warm_up": "proximity.tracker.warm_up",
}


if not TYPE_CHECKING:  # a type checker would take every misspelt name for one that this finds

    def __getattr__(name: str) -> Any:
        """Import a public name when it is first asked for, and keep it."""
        module = _MODULE_OF.get(name)
        if module is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(module), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Name what is public, imported already or not."""
    return sorted({*globals(), *__all__})
