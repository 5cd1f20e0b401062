"""Poses: composition, inverses, and errors for transforms that are not rigid."""

import re

import numpy as np
import pytest
import shapes
from scipy.spatial.transform import Rotation

from proximity.errors import ArgumentError, PoseError
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

QUARTER = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def some_pose(seed=1):
    return Pose(shapes.rotation(seed), np.random.default_rng(seed).uniform(-5.0, 5.0, 3))


def test_nobody_can_change_the_pose_that_all_share():
    with pytest.raises(ValueError, match="WRITEABLE"):
        Pose().rotation.flags.writeable = True


def test_identity_changes_nothing():
    pose = Pose()

    assert pose.is_identity
    assert pose.point([1.0, 2.0, 3.0]).tolist() == [1.0, 2.0, 3.0]
    assert pose.matrix.tolist() == np.eye(4).tolist()


def test_points_turn_and_shift_and_directions_only_turn():
    pose = Pose(QUARTER, (10.0, 0.0, 0.0))

    assert pose.point([1.0, 2.0, 3.0]).tolist() == [8.0, 1.0, 3.0]
    assert pose.direction([1.0, 2.0, 3.0]).tolist() == [-2.0, 1.0, 3.0]
    assert not pose.is_identity
    assert not Pose(translation=(1.0, 0.0, 0.0)).is_identity


@pytest.mark.parametrize("shape", [(3,), (0, 3), (2, 4, 3)])
def test_points_keep_their_shape(shape):
    assert some_pose().point(np.ones(shape)).shape == shape
    assert some_pose().direction(np.ones(shape)).shape == shape


def test_rotation_that_is_off_is_mended_to_the_last_bits_and_once():
    """The nearest rotation, within the rounding of products, for any linear algebra library."""
    rng = np.random.default_rng(3)
    for seed in range(200):
        off = shapes.rotation(seed) @ (np.eye(3) + rng.uniform(-2e-10, 2e-10, (3, 3)))
        rotation = Pose(off).rotation

        assert np.abs(rotation @ rotation.T - np.eye(3)).max() <= 4 * 2.0**-52
        assert np.abs(rotation - off).max() <= 1e-9
        assert np.array_equal(Pose(rotation).rotation, rotation)


def test_inverse_leads_back():
    pose, points = some_pose(), np.random.default_rng(2).uniform(-5.0, 5.0, (20, 3))

    assert np.abs(pose.inverse.point(pose.point(points)) - points).max() <= 1e-14
    assert np.abs((pose @ pose.inverse).matrix - np.eye(4)).max() <= 1e-14


def test_chained_poses_are_one():
    first, second, point = some_pose(1), some_pose(2), np.array([1.0, 2.0, 3.0])

    assert np.abs((first @ second).point(point) - first.point(second.point(point))).max() <= 1e-14
    assert np.abs((first @ second).matrix - first.matrix @ second.matrix).max() <= 1e-14


def test_a_pose_is_chained_with_poses_only():
    with pytest.raises(TypeError, match="unsupported operand"):
        Pose() @ 3


def test_matrix_and_pose_are_the_same():
    pose = some_pose()

    assert np.array_equal(Pose.from_matrix(pose.matrix).matrix, pose.matrix)
    assert np.array_equal(Pose.of(pose.matrix.tolist()).matrix, pose.matrix)
    assert Pose.of(pose) is pose
    assert repr(Pose()).startswith("Pose(rotation=[[1.0, 0.0, 0.0], ")


def test_exact_rotation_is_kept_and_a_rounded_one_made_exact():
    rounded = np.round(shapes.rotation(4), 10)

    assert Pose(QUARTER).rotation.tolist() == QUARTER
    rotation = Pose(rounded).rotation
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() <= 1e-15
    assert np.abs(rotation - rounded).max() <= 1e-9


@pytest.mark.parametrize("field", ["rotation", "translation"])
def test_arrays_are_read_only_copies(field):
    given = {"rotation": np.eye(3), "translation": np.zeros(3)}
    pose = Pose(**given)

    given[field][0] = 7.0

    assert getattr(pose, field).max() <= 1.0
    with pytest.raises(ValueError, match="read-only"):
        getattr(pose, field)[0] = 7.0


@pytest.mark.parametrize(
    "rotation, message",
    [
        (np.eye(4), "a pose's rotation has shape (4, 4), expected (3, 3)"),
        (np.ones(3), "a pose's rotation has shape (3,), expected (3, 3)"),
        ([["a"] * 3] * 3, "entries of a pose's rotation have dtype <U1, expected numbers of shape (3, 3)"),
        ([[1, 0, 0], [0, 1], [0]], "entries of a pose's rotation have rows of different lengths"),
        (np.eye(3) * np.nan, "a pose's rotation is not finite, expected an orthonormal matrix"),
        (np.full((3, 3), np.inf), "a pose's rotation is not finite, expected an orthonormal matrix"),
        (np.eye(3) * 2.0, "(rotation times its transpose is off by 3): a pose can rotate and translate, but"),
        (np.eye(3) + 1e-5, "a pose's rotation is not orthonormal"),
        (np.zeros((3, 3)), "a pose's rotation is not orthonormal"),
        (np.full((3, 3), 1e200), "a pose's rotation is not orthonormal"),
        ([[1e200, 1e200, 0], [1e200, -1e200, 0], [0, 0, 1]], "a pose's rotation is not orthonormal"),
        (np.diag([1.0, 1.0, -1.0]), "a pose's rotation mirrors (determinant -1), expected +1"),
    ],
)
def test_rotation_that_is_none_is_refused(rotation, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        Pose(rotation)


@pytest.mark.parametrize(
    "translation, message",
    [
        ([1.0, 2.0], "a pose's translation has shape (2,), expected (3,)"),
        ([[1.0, 2.0, 3.0]], "a pose's translation has shape (1, 3), expected (3,)"),
        ([0.0, np.nan, 0.0], "a pose's translation is [0.0, nan, 0.0], expected finite numbers"),
        ("abc", "entries of a pose's translation have dtype <U3, expected 3 numbers"),
    ],
)
def test_translation_that_is_none_is_refused(translation, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        Pose(None, translation)


@pytest.mark.parametrize(
    "matrix, message",
    [
        (np.eye(3), "a pose's matrix has shape (3, 3), expected (4, 4)"),
        (None, "entries of a pose's matrix hold None, which is not a number, expected numbers of shape"),
        ("pose", "entries of a pose's matrix have dtype <U4, expected numbers of shape (4, 4)"),
        (2.0 * np.eye(4), "the last row of a pose's matrix is [0.0, 0.0, 0.0, 2.0], expected [0, 0, 0, 1]"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "a pose's rotation is not orthonormal"),
        (np.eye(4)[::-1], "the last row of a pose's matrix is [1.0, 0.0, 0.0, 0.0], expected [0, 0, 0, 1]"),
    ],
)
def test_matrix_that_is_no_pose_is_refused(matrix, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        Pose.of(matrix)


@pytest.mark.parametrize("points", ["x", [1.0, 2.0], None, [1.0, 2.0, 3j]])
def test_points_that_are_none_are_refused(points):
    with pytest.raises(ArgumentError, match=r"^points .* expected"):
        Pose().point(points)
    with pytest.raises(ArgumentError, match=r"^directions .* expected"):
        Pose().direction(points)


def test_quaternion_is_a_pose_scalar_last():
    half = np.sqrt(0.5)
    pose = Pose.from_quaternion((0.0, 0.0, half, half), (1.0, 2.0, 3.0))

    np.testing.assert_allclose(pose.point((1.0, 0.0, 0.0)), (1.0, 3.0, 3.0), atol=1e-15)
    assert Pose.from_quaternion((0, 0, 0, 1)).is_identity


@pytest.mark.parametrize("seed", range(5))
def test_quaternion_turns_as_scipy_says(seed):
    xyzw = np.random.default_rng(seed).normal(size=4)
    xyzw /= np.linalg.norm(xyzw)

    for given in (xyzw, -xyzw, xyzw * 1.005, xyzw.round(3)):
        expected = Rotation.from_quat(given).as_matrix()
        np.testing.assert_allclose(Pose.from_quaternion(given).rotation, expected, atol=1e-14)


@pytest.mark.parametrize(
    "xyzw, message",
    [
        ((0, 0, 0, 0), "a quaternion is [0.0, 0.0, 0.0, 0.0], of norm 0, expected 4 numbers of norm 1"),
        ((0, 0, 0, 2), "a quaternion is [0.0, 0.0, 0.0, 2.0], of norm 2, expected 4 numbers of norm 1"),
        ((0, 0, np.nan, 1), "a quaternion is [0.0, 0.0, nan, 1.0], of norm nan, expected 4 numbers of norm "),
        ((0, 0, np.inf, 1), "a quaternion is [0.0, 0.0, inf, 1.0], of norm inf, expected 4 numbers of norm "),
        ((1, 0, 0), "a quaternion has shape (3,), expected (4,): x, y, z, w"),
        ("xyzw", "entries of a quaternion have dtype <U4, expected 4 numbers x, y, z, w"),
    ],
)  # fmt: skip
def test_quaternion_that_is_none_is_refused(xyzw, message):
    with pytest.raises(ArgumentError, match=f"^{re.escape(message)}"):
        Pose.from_quaternion(xyzw)


@pytest.mark.parametrize("given", [(0, 0, 0, 1), (0.1, 0.2, 0.3, 0, 0, 0, 1)])
def test_quaternion_in_place_of_a_pose_is_told_how_to_become_one(given):
    hint = re.escape("; Pose.from_quaternion(xyzw, translation) makes a pose of a quaternion") + "$"
    scene = Scene([Solid(*shapes.cube(), name="cube")])
    asks = [
        lambda: Pose(given),
        lambda: Pose.of(given),
        lambda: scene.move("cube", given),
        lambda: scene.move("cube", np.array(given, float)),
        lambda: scene.move_many(["cube"], [given]),
    ]
    for ask in asks:
        with pytest.raises(PoseError, match=hint):
            ask()
    with pytest.raises(PoseError, match=r"expected \(4, 4\)$"):
        Pose.of(np.eye(3))


@pytest.mark.parametrize("convert", [np.asarray, lambda matrix: matrix.tolist()])
def test_rotation_in_single_precision_is_taken_as_the_nearest(convert):
    """OpenXR, Unity and Eigen::Matrix3f use it; a quaternion could be off by a hundredth."""
    for seed in range(50):
        exact = shapes.rotation(seed)
        rotation = Pose(convert(exact.astype(np.float32))).rotation

        assert np.abs(rotation - exact).max() <= 1e-7
        assert np.abs(rotation @ rotation.T - np.eye(3)).max() <= 4 * 2.0**-52
        assert np.array_equal(Pose(rotation).rotation, rotation)


@pytest.mark.parametrize(("stretch", "is_taken"), [(4e-6, True), (6e-6, False)])
def test_nearest_rotation_is_meant_up_to_a_hundred_thousandth(stretch, is_taken):
    matrix = shapes.rotation(7) @ np.diag([1.0 + stretch, 1.0, 1.0])
    if is_taken:
        np.testing.assert_allclose(Pose(matrix).rotation, shapes.rotation(7), atol=1e-14)
    else:
        with pytest.raises(
            PoseError, match=r"not orthonormal \(rotation times its transpose is off by 1.19e-05\)"
        ):
            Pose(matrix)
