"""Rigid transforms, which are named ``target_from_source``.

A pose rotates and translates; it never scales, shears or mirrors. Adjacent names in a product match, as in
``world_from_tool = world_from_solid @ solid_from_tool``.
"""

from typing import Any

import numpy as np

from proximity.checks import as_float64, as_points, shown_number
from proximity.errors import PoseError

ORTHONORMAL_TOLERANCE = 1e-9
"""Maximum difference of a rotation times its transpose from the identity. It permits the error of a
quaternion in float64 or of a product of many matrices. One step towards the nearest exact rotation removes
it."""
SINGLE_TOLERANCE = 1e-5
"""Maximum difference for a rotation in single precision, whose error is about a millionth. Up to here the
nearest rotation is used; a larger difference is a scale or shear."""
QUATERNION_TOLERANCE = 0.01
"""Maximum difference of the norm of a quaternion from 1, which exceeds the error of three decimal places."""
ROUNDING = 8.0 * 2.0**-52
"""Error of the nearest exact rotation in float64. Within it a pose of a pose's matrix is equal to that
pose."""


def _for_all(array: np.ndarray) -> np.ndarray:
    """Return a read-only view of an array that cannot be made writeable again."""
    array.flags.writeable = False
    return array.view()


_UNTURNED, _UNMOVED = _for_all(np.eye(3)), _for_all(np.zeros(3))


def quaternion_hint(array: np.ndarray) -> str:
    """Return advice for an error message if quaternions were given instead of poses, else "".

    *array*: the value given as a pose or as poses.
    """
    is_quaternion = array.shape[-1:] in ((4,), (7,)) and array.shape[-2:] != (4, 4)
    return "; Pose.from_quaternion(xyzw, translation) makes a pose of a quaternion" if is_quaternion else ""


def nearest_rotations(rotations: np.ndarray) -> np.ndarray:
    """Return rotations in which those of single precision are replaced by the nearest exact ones.

    *rotations*: (K, 3, 3). Other matrices are unchanged.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # values from a sender are arbitrary
        off = np.abs(rotations @ rotations.transpose(0, 2, 1) - _UNTURNED).max(axis=(1, 2), initial=0.0)
    rows = (off > ORTHONORMAL_TOLERANCE) & (off <= SINGLE_TOLERANCE)
    if rows.any():
        left, _, right = np.linalg.svd(rotations[rows])
        rotations = rotations.copy()
        rotations[rows] = left @ right
    return rotations


class Pose:
    """A rotation and a translation that transform points of the source frame to the target frame.

    Parameters
    ----------
    rotation : (3, 3) float64
        Orthonormal matrix with determinant +1. If it differs by at most 1e-5, as in single precision, the
        nearest rotation replaces it. Default: the identity.
    translation : (3,) float64, m
        Default: zero.

    Raises
    ------
    PoseError
        If they are not a rigid transform.
    """

    __slots__ = ("rotation", "translation")

    rotation: np.ndarray  # (3, 3) float64, read-only
    translation: np.ndarray  # (3,) float64, m, read-only

    def __init__(self, rotation: Any = None, translation: Any = None) -> None:
        self.rotation = _UNTURNED if rotation is None else _checked_rotation(rotation)
        self.translation = _UNMOVED if translation is None else _checked_translation(translation)
        self.rotation.flags.writeable = False
        self.translation.flags.writeable = False

    def __reduce__(self) -> tuple[Any, ...]:
        return Pose.known, (self.rotation, self.translation)

    @classmethod
    def from_matrix(cls, matrix: Any) -> "Pose":
        """Return the pose of a homogeneous (4, 4) matrix that acts on columns.

        Parameters
        ----------
        matrix : (4, 4) float64
            Last row (0, 0, 0, 1); translation in metres.

        Raises
        ------
        PoseError
            If it is not a rigid transform.
        """
        array = as_float64(matrix, "entries of a pose's matrix", expected="numbers of shape (4, 4)")
        if array.shape != (4, 4):
            raise PoseError(
                f"a pose's matrix has shape {array.shape}, expected (4, 4){quaternion_hint(array)}"
            )
        if not np.array_equal(array[3], (0.0, 0.0, 0.0, 1.0)):
            raise PoseError(f"the last row of a pose's matrix is {array[3].tolist()}, expected [0, 0, 0, 1]")
        return cls(array[:3, :3], array[:3, 3])

    @classmethod
    def from_quaternion(cls, xyzw: Any, translation: Any = None) -> "Pose":
        """Return the pose of a unit quaternion, scalar last: (x, y, z, w), as in SciPy and ROS.

        Parameters
        ----------
        xyzw : (4,) float64
            Of norm 1, within 1 %; it is divided by its norm. (0, 0, 0, 1) is the identity.
        translation : (3,) float64, m
            Default: zero.

        Raises
        ------
        PoseError
            If it is not a unit quaternion, or the translation is not 3 finite numbers.
        """
        array = as_float64(xyzw, "entries of a quaternion", expected="4 numbers x, y, z, w")
        if array.shape != (4,):
            raise PoseError(f"a quaternion has shape {array.shape}, expected (4,): x, y, z, w")
        norm = float(np.linalg.norm(array))
        if not abs(norm - 1.0) <= QUATERNION_TOLERANCE:
            raise PoseError(
                f"a quaternion is {shown_number(array)}, of norm {norm:.6g}, expected 4 numbers of norm 1"
            )
        x, y, z, w = array / norm
        rotation = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
        return cls(rotation, translation)

    @classmethod
    def known(cls, rotation: np.ndarray, translation: np.ndarray) -> "Pose":
        """Return the pose of a transform that is known to be rigid. Arrays are copied, not validated.

        Parameters
        ----------
        rotation : (3, 3) float64
            Orthonormal.
        translation : (3,) float64, m
            Finite.
        """
        pose = cls.__new__(cls)
        pose.rotation, pose.translation = rotation.copy(), translation.copy()
        pose.rotation.flags.writeable = False
        pose.translation.flags.writeable = False
        return pose

    @classmethod
    def of(cls, pose: Any) -> "Pose":
        """Return *pose*, a `Pose` or a (4, 4) matrix, as a `Pose`.

        Parameters
        ----------
        pose : Pose or (4, 4) array-like
            The pose.

        Raises
        ------
        PoseError
            If it is neither.
        """
        return pose if isinstance(pose, Pose) else cls.from_matrix(pose)

    @property
    def matrix(self) -> np.ndarray:
        """Homogeneous (4, 4) matrix of the pose."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation
        return matrix

    @property
    def is_identity(self) -> bool:
        """True if the pose is the identity."""
        return bool(np.array_equal(self.rotation, np.eye(3)) and not self.translation.any())

    @property
    def inverse(self) -> "Pose":
        """Inverse pose, ``source_from_target``."""
        return Pose(self.rotation.T, -(self.rotation.T @ self.translation))

    def point(self, points: Any) -> np.ndarray:
        """Transform points (..., 3), m, from the source frame to the target frame.

        Parameters
        ----------
        points : (..., 3) float64, m, source frame
            Positions.

        Raises
        ------
        ArgumentError
            If they are not numbers of shape (..., 3).
        """
        return as_points(points) @ self.rotation.T + self.translation

    def direction(self, directions: Any) -> np.ndarray:
        """Rotate directions (..., 3) from the source frame to the target frame, without translating them.

        Parameters
        ----------
        directions : (..., 3) float64, source frame
            Directions, velocities, normals.

        Raises
        ------
        ArgumentError
            If they are not numbers of shape (..., 3).
        """
        return as_points(directions, "directions") @ self.rotation.T

    def __matmul__(self, other: "Pose") -> "Pose":
        if not isinstance(other, Pose):
            return NotImplemented
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def __repr__(self) -> str:
        return f"Pose(rotation={shown_number(self.rotation)}, translation={shown_number(self.translation)})"


def _checked_rotation(rotation: Any) -> np.ndarray:
    array = as_float64(rotation, "entries of a pose's rotation", expected="numbers of shape (3, 3)")
    if array.shape != (3, 3):
        raise PoseError(f"a pose's rotation has shape {array.shape}, expected (3, 3){quaternion_hint(array)}")
    if not np.isfinite(array).all():
        raise PoseError("a pose's rotation is not finite, expected an orthonormal matrix")
    with np.errstate(over="ignore", invalid="ignore"):
        off = float(np.abs(array @ array.T - np.eye(3)).max())
    if not off <= SINGLE_TOLERANCE:
        raise PoseError(
            f"a pose's rotation is not orthonormal (rotation times its transpose is off by {off:.3g}): "
            "a pose can rotate and translate, but not scale or shear"
        )
    if np.linalg.det(array) < 0.0:
        raise PoseError("a pose's rotation mirrors (determinant -1), expected +1")
    if off > ORTHONORMAL_TOLERANCE:
        array = nearest_rotations(array[None])[0]
    elif off <= ROUNDING:
        return array.copy()
    # A step of Newton's iteration towards the nearest rotation reduces an error of 1e-9 to rounding.
    return array + 0.5 * (_UNTURNED - array @ array.T) @ array


def _checked_translation(translation: Any) -> np.ndarray:
    array = as_float64(translation, "entries of a pose's translation", expected="3 numbers")
    if array.shape != (3,):
        raise PoseError(f"a pose's translation has shape {array.shape}, expected (3,)")
    if not np.isfinite(array).all():
        raise PoseError(f"a pose's translation is {array.tolist()}, expected finite numbers")
    return array.copy()
