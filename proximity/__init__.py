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
        MeshError,
        MeshFormatError,
        NotWatertightError,
        PoseError,
        ProximityError,
        QueryError,
        RecordingError,
        SceneError,
    )
    from proximity.loading import load
    from proximity.mesh import TriangleMesh
    from proximity.message import CONTACT, ContactFlag, Surface
    from proximity.pose import Pose
    from proximity.results import NO_FACE, ClosestPoints, Feature, RayHits, SegmentHits
    from proximity.scene import Part, Scene
    from proximity.sign import SignMethod
    from proximity.solid import Solid
    from proximity.tracker import Tracker
    from proximity.warmup import kernels_are_cached, warm_up

__version__ = "0.1.0"

__all__ = [
    "CONTACT",
    "NO_FACE",
    "ClosestPoints",
    "ContactFlag",
    "Feature",
    "MeshError",
    "MeshFormatError",
    "NotWatertightError",
    "Part",
    "Pose",
    "PoseError",
    "ProximityError",
    "QueryError",
    "RayHits",
    "RecordingError",
    "Scene",
    "SceneError",
    "SegmentHits",
    "SignMethod",
    "Solid",
    "Surface",
    "Tracker",
    "TriangleMesh",
    "kernels_are_cached",
    "load",
    "warm_up",
]

_MODULE_OF = {
    "CONTACT": "proximity.message",
    "NO_FACE": "proximity.results",
    "ClosestPoints": "proximity.results",
    "ContactFlag": "proximity.message",
    "Feature": "proximity.results",
    "MeshError": "proximity.errors",
    "MeshFormatError": "proximity.errors",
    "NotWatertightError": "proximity.errors",
    "Part": "proximity.scene",
    "Pose": "proximity.pose",
    "PoseError": "proximity.errors",
    "ProximityError": "proximity.errors",
    "QueryError": "proximity.errors",
    "RayHits": "proximity.results",
    "RecordingError": "proximity.errors",
    "Scene": "proximity.scene",
    "SceneError": "proximity.errors",
    "SegmentHits": "proximity.results",
    "SignMethod": "proximity.sign",
    "Solid": "proximity.solid",
    "Surface": "proximity.message",
    "Tracker": "proximity.tracker",
    "TriangleMesh": "proximity.mesh",
    "kernels_are_cached": "proximity.warmup",
    "load": "proximity.loading",
    "warm_up": "proximity.warmup",
}


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
