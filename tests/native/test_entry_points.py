"""Entry points accept arguments of their signatures, and report errors in others."""

import gc

import numpy as np
import pytest
import shapes
from growing import traced_growth

from proximity import native
from proximity.errors import ArgumentError
from proximity.kernels import entries
from proximity.kernels.geometry.morton_order import morton_order
from proximity.kernels.layout import FRAME, PART, ModelArrays
from proximity.kernels.mesh.faces import signed_volume, thin_faces
from proximity.kernels.scene.parts.placement import first_unfit, update_box
from proximity.kernels.scene.queries.point_queries import signed_batch
from proximity.kernels.tree.builder import build_tree
from proximity.native import declaration
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

pytestmark = pytest.mark.skipif(not native.IS_AHEAD, reason="no kernels compiled ahead of time are in use")


def test_results_are_arrays_numbers_and_tuples():
    vertices, faces = shapes.cube(2.0)
    faces = faces.astype(np.int32)

    assert signed_volume(vertices, faces) == pytest.approx(6 * 8.0)
    assert thin_faces(vertices, faces, 1e-9).dtype == np.bool_
    nodes, order, leaf_first = build_tree(np.zeros(8, np.float32), 3)
    assert (nodes.dtype, order.dtype, leaf_first.dtype) == (np.float32, np.int32, np.int32)


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((4, 3), np.float32),
        np.zeros((4, 3, 1)),
        np.zeros((4, 2)),
        np.zeros((3, 4)).T,
        np.zeros((8, 3))[::2],
        np.zeros((4, 3), ">f8"),
    ],
    ids=["dtype", "axes", "length", "order", "stride", "byte order"],
)
def test_arrays_of_another_kind_are_refused(points):
    with pytest.raises(
        TypeError, match=r"morton_order: argument 0 is an array with .* dtype float64, C order"
    ):
        morton_order(points)


def test_what_is_no_array_is_refused():
    with pytest.raises(TypeError, match="morton_order: argument 0 is <class 'list'>, expected array"):
        morton_order([[0.0, 0.0, 0.0]])


def test_a_wrong_number_of_arguments_is_refused():
    with pytest.raises(TypeError, match="morton_order takes 1 arguments, 2 were given"):
        morton_order(np.zeros((1, 3)), 1)


def test_numbers_of_another_kind_are_refused():
    frames, parts = np.zeros(2, FRAME), np.zeros(2, PART)
    with pytest.raises(TypeError, match="update_box: argument 2 is <class 'str'>, expected int"):
        update_box(frames, parts, "0")
    with pytest.raises(TypeError, match="update_box: argument 2 is <class 'float'>, expected int"):
        update_box(frames, parts, 0.0)
    with pytest.raises(OverflowError):
        update_box(frames, parts, 2**63)
    with pytest.raises(TypeError, match="first_unfit: argument 3 is <class 'str'>, expected float"):
        first_unfit(np.zeros((0, 4, 4)), np.zeros((0, 3)), np.zeros((0, 3)), "1e-9", 1.0, 1.0)


def test_records_of_another_size_and_plain_numbers_are_refused():
    for frames in (np.zeros((2, 48)), np.zeros(2, PART)):
        with pytest.raises(TypeError, match="update_box: argument 0 is an array"):
            update_box(frames, np.zeros(2, PART), 0)


def test_numpy_scalars_count_as_numbers():
    frames, parts = np.zeros(2, FRAME), np.zeros(2, PART)
    update_box(frames, parts, np.int32(0))
    update_box(frames, parts, np.bool_(False))


def test_bundles_are_made_of_arrays_as_declared_and_keep_them():
    with pytest.raises(TypeError, match="ModelArrays: argument 1 is an array with 1 axes and dtype float64"):
        native.packed(ModelArrays(np.zeros(1), np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1), np.int64)))
    with pytest.raises(TypeError, match="signed_batch: argument 0 is <class 'tuple'>, expected bundle"):
        signed_batch((), np.zeros((1, 3)), np.zeros(0, np.int64), np.zeros(1), np.zeros((1, 1)))

    packed = Solid(*shapes.cube()).snapshot().packed
    gc.collect()  # the model is freed, its arrays are not
    distances = np.empty((1, 1))
    signed_batch(packed, np.array([[0.5, 0.5, 2.0]]), np.zeros(0, np.int64), np.full(1, np.inf), distances)
    assert distances[0, 0] == 1.0


def test_a_bundle_of_another_kind_is_refused():
    from proximity.kernels.layout import DynamicParts

    other = native.packed(DynamicParts(*(np.zeros(0, np.int64) for _ in range(3))))
    with pytest.raises(TypeError, match="signed_batch: argument 0 is"):
        signed_batch(other, np.zeros((1, 3)), np.zeros(0, np.int64), np.zeros(1), np.zeros((1, 1)))


def test_arrays_that_a_kernel_made_are_freed_with_their_last_view():
    points = np.random.default_rng(7).random((100_000, 3))
    view = morton_order(points)[10:]
    gc.collect()
    assert sorted(view.tolist())[-1] == 99_999  # still valid

    import resource

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(200):  # 160 MB if they leaked
        morton_order(points)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def refused(error, call, given):
    """Call with an invalid argument; expect that error."""
    with pytest.raises(error):
        call(given)


SCENE = Scene([Solid(*shapes.cube(), name="cube"), Solid(*shapes.sphere(0.3, 1), name="ball")])
ROWS = np.linspace(-2.0, 3.0, 12).reshape(4, 3)
CALLS = {
    "entry point": lambda: morton_order(ROWS),
    "few rows": lambda: SCENE.closest(ROWS),
    "a list": lambda: SCENE.signed_distance([0.0, 0.0, 2.0]),
    "rays": lambda: SCENE.cast(ROWS, -ROWS),
    "what is refused": lambda: refused(ArgumentError, SCENE.closest, "up"),
    "what does not fit": lambda: refused(TypeError, morton_order, None),
}


@pytest.mark.parametrize("name", CALLS)
def test_calls_leave_no_python_objects_behind(name):
    call = CALLS[name]

    def thousand_calls():
        for _ in range(1000):
            call()

    for _ in range(20):
        call()
    assert traced_growth(thousand_calls) < 10_000


def test_compiled_code_of_its_own_cannot_be_called_from_python():
    from proximity.kernels.geometry.frames import to_local

    with pytest.raises(TypeError, match=r"frames\.to_local is called by compiled code only"):
        to_local(None, None, 0, 0.0, 0.0, 0.0)


def test_the_table_of_the_extension_has_what_modules_declare():
    native.import_entries()

    assert "signed_batch" in native.ENTRIES
    for name, declared in native.ENTRIES.items():
        compiled = declaration._entry(name)
        assert (compiled.signature, compiled.rows_with_gil) == (declared.signature, declared.rows_with_gil)
        assert getattr(entries, name).__name__ == "entry"


def test_a_name_that_no_entry_point_has_is_an_error_of_import():
    with pytest.raises(ImportError, match="cannot import name 'closest_batches'"):
        from proximity.kernels.entries import closest_batches  # noqa: F401
    with pytest.raises(AttributeError, match="there is no entry point 'closest_batches'"):
        _ = entries.closest_batches
