"""Public names, and where they are: what type checkers read, and what `proximity` imports from when asked."""

from proximity.errors import ArgumentError as ArgumentError
from proximity.errors import DecaffError as DecaffError
from proximity.errors import FileError as FileError
from proximity.errors import FileVersionError as FileVersionError
from proximity.errors import MeshError as MeshError
from proximity.errors import MeshFormatError as MeshFormatError
from proximity.errors import MissingLibraryError as MissingLibraryError
from proximity.errors import MotorError as MotorError
from proximity.errors import NotWatertightError as NotWatertightError
from proximity.errors import PoseError as PoseError
from proximity.errors import ProximityError as ProximityError
from proximity.errors import PublishError as PublishError
from proximity.errors import RecordingError as RecordingError
from proximity.errors import SceneError as SceneError
from proximity.errors import ServiceError as ServiceError
from proximity.errors import UnitsWarning as UnitsWarning
from proximity.mesh.triangle_mesh import TriangleMesh as TriangleMesh
from proximity.message import ADDITIONS as ADDITIONS
from proximity.message import CHANGES as CHANGES
from proximity.message import CONTACT as CONTACT
from proximity.message import DEFORMATIONS as DEFORMATIONS
from proximity.message import FRAME as FRAME
from proximity.message import GLOVE_POSES as GLOVE_POSES
from proximity.message import MEASURED as MEASURED
from proximity.message import MOVES as MOVES
from proximity.message import PATH_POSES as PATH_POSES
from proximity.message import POSES as POSES
from proximity.message import ContactFlag as ContactFlag
from proximity.message import Message as Message
from proximity.message import Mode as Mode
from proximity.message import PartAction as PartAction
from proximity.message import Source as Source
from proximity.message import State as State
from proximity.message import Surface as Surface
from proximity.native.warm_up import kernels_are_cached as kernels_are_cached
from proximity.native.warm_up import warm_up as warm_up
from proximity.pose import Pose as Pose
from proximity.scene.loader import load as load
from proximity.scene.overlap import Overlap as Overlap
from proximity.scene.overlap import overlap as overlap
from proximity.scene.pairs import Clearance as Clearance
from proximity.scene.pairs import Relation as Relation
from proximity.scene.part import LoadReport as LoadReport
from proximity.scene.part import Part as Part
from proximity.scene.queries.results import NO_FACE as NO_FACE
from proximity.scene.queries.results import NO_PART as NO_PART
from proximity.scene.queries.results import ClosestPoints as ClosestPoints
from proximity.scene.queries.results import Feature as Feature
from proximity.scene.queries.results import RayHits as RayHits
from proximity.scene.queries.results import SegmentHits as SegmentHits
from proximity.scene.scene import Scene as Scene
from proximity.scene.sign import SignMethod as SignMethod
from proximity.scene.solid import Solid as Solid
from proximity.scene.trimesh_scene import from_mesh as from_mesh
from proximity.scene.trimesh_scene import from_trimesh as from_trimesh
from proximity.scene.trimesh_scene import to_trimesh as to_trimesh
from proximity.service.hosting import RunningService as RunningService
from proximity.service.hosting import serve as serve
from proximity.service.hosting import start_service as start_service
from proximity.tracker.part_tracker import CONNECTION as CONNECTION
from proximity.tracker.part_tracker import ConnectionFlag as ConnectionFlag
from proximity.tracker.part_tracker import PartTracker as PartTracker
from proximity.tracker.tracker import Tracker as Tracker
from proximity.transport import Publisher as Publisher
from proximity.transport import Reading as Reading
from proximity.transport import Subscriber as Subscriber
from proximity.transport import open_publisher as open_publisher
from proximity.transport import open_subscriber as open_subscriber
from proximity.web import RunningPage as RunningPage
from proximity.web import view as view

__version__: str
__all__: list[str]

def __dir__() -> list[str]: ...
