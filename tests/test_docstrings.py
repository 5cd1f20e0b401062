"""Exceptions for callers to catch, types of answers, and the form of docstrings."""

import inspect
import re
import subprocess
import sys

import pytest

import proximity
from proximity import errors

TREE = {
    "ProximityError": Exception, "MeshError": errors.ProximityError, "MeshFormatError": errors.MeshError,
    "FileVersionError": errors.MeshFormatError, "NotWatertightError": errors.MeshError,
    "ArgumentError": errors.ProximityError,
    "PoseError": errors.ArgumentError, "FileError": errors.ProximityError,
    "MissingLibraryError": errors.ProximityError, "SceneError": errors.ProximityError,
    "RecordingError": errors.ProximityError, "PublishError": errors.ProximityError,
    "ServiceError": errors.ProximityError, "DecaffError": errors.ProximityError,
    "MotorError": errors.ProximityError, "UnitsWarning": UserWarning,
}  # fmt: skip
NOT_VALUES = {
    "FileError", "MissingLibraryError", "MotorError", "ProximityError", "PublishError", "UnitsWarning",
}  # fmt: skip


def test_tree_is_the_one_that_is_drawn():
    defined = {name: value for name, value in vars(errors).items() if inspect.isclass(value)}

    assert set(defined) == set(TREE)


@pytest.mark.parametrize("name", TREE)
def test_error_stands_below_its_parent_and_is_documented(name):
    error = getattr(errors, name)

    assert error.__bases__[0] is TREE[name]
    assert error.__doc__.endswith(".")
    assert str(error("one sentence")) == "one sentence"


@pytest.mark.parametrize("name", [name for name in TREE if name not in NOT_VALUES])
def test_bad_values_are_value_errors_too(name):
    """Callers who do not know the package can catch ValueError."""
    assert issubclass(getattr(errors, name), ValueError)


SNIPPET = """
import numpy as np
import numpy.typing as npt
import proximity

Reals = npt.NDArray[np.float64]
scene = proximity.load("part.stl")
points, ways = np.zeros((5, 3)), [[0, 0, 1]]

hits = scene.closest(points, max_distance=[0.1])
near: Reals = hits.point[hits.signed_distance < 0.01]
depth: float = float(scene.closest((0.0, 0.0, 0.0)).signed_distance)
reals: list[Reals] = [hits.signed_distance, hits.gradient, hits.barycentric]
reals += [scene.signed_distance(points), scene.distance(points), scene.cast_distance(points, ways)]
reals += [scene.cast(points, ways).normal, scene.closest_to_segments(points, ways).fraction]
faces: npt.NDArray[np.int32] = hits.face_id
flags: npt.NDArray[np.bool_] = hits.is_signed
held: npt.NDArray[np.bool_] = scene.contains(points)

wrong_face: Reals = hits.face_id
wrong_point: str = hits.point
wrong_flag: Reals = hits.is_signed
wrong_distance: Reals = scene.contains(points)
wrong_hit: npt.NDArray[np.int32] = scene.cast(points, ways).distance
scene.closest(points, max_distance=object())
contacts = proximity.Tracker(scene).tick([[0.0, 0.0, 0.1]] * 5, 10**9, 10**9, velocities=points)
fields = contacts[contacts["flags"] > 0]["signed_distance"], [each["upper"] for each in contacts]
wrong_field = contacts["signed_distanse"], contacts["lower"]
wrong_row = [each["uper"] for each in contacts]
wrong_reading = proximity.open_subscriber("shm://a").read().contacts["signed_distanse"]
proximity.Tracker(scene).tick(object(), 1, 1)
"""


@pytest.mark.processes
def test_types_of_answers_are_known(tmp_path):
    """With an unknown type, the wrong lines would pass."""
    user = tmp_path / "user.py"
    user.write_text(SNIPPET)

    checked = [sys.executable, "-m", "mypy", "--strict", "--config-file=", f"--cache-dir={tmp_path}/cache"]
    done = subprocess.run([*checked, str(user)], capture_output=True, text=True)

    wrong = [k for k, line in enumerate(SNIPPET.splitlines(), 1) if "wrong_" in line or "object()" in line]
    found = [line for line in done.stdout.splitlines() if ": error: " in line and "user.py" in line]
    assert [int(line.split("user.py:")[1].split(":")[0]) for line in found] == wrong, done.stdout


CLASSES = [name for name in proximity.__all__ if inspect.isclass(getattr(proximity, name))]
FUNCTIONS = [name for name in proximity.__all__ if inspect.isfunction(getattr(proximity, name))]
SECTIONS = ["Parameters", "Returns", "Raises", "Notes"]
NOTES_KEYS = ["Sign", "On the surface", "Ties", "Degenerate", "Cost", "Thread", "Source"]
OPERATORS = {"__init__", "__repr__", "__eq__", "__hash__", "__matmul__"}


def public_methods():
    """Yield (name, function) of methods and properties of public classes, including inherited ones."""
    for name in CLASSES:
        for member in dir(getattr(proximity, name)):
            value = inspect.getattr_static(getattr(proximity, name), member)
            value = getattr(value, "__func__", getattr(value, "fget", None) or getattr(value, "func", value))
            is_ours = inspect.isfunction(value) and value.__module__.startswith("proximity.")
            if is_ours and not member.startswith("_"):
                yield f"{name}.{member}", value


METHODS = dict(public_methods())
CALLABLES = {name: getattr(proximity, name) for name in FUNCTIONS} | METHODS


def sections_of(documentation):
    """Return the text of each section by its title, the summary by ''."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", documentation, flags=re.MULTILINE)
    return {"": parts[0]} | dict(zip(parts[1::2], parts[2::2], strict=True))


def documented_parameters(documentation):
    """Return names at the left edge of the section on parameters; several may share a line."""
    text = sections_of(documentation).get("Parameters", "")
    heads = [line.split(" : ")[0] for line in text.splitlines() if line and not line.startswith(" ")]
    return [name.strip() for head in heads for name in head.split(",")]


def parameters_of(function):
    return [name for name in inspect.signature(function).parameters if name not in ("self", "cls")]


def test_there_is_something_to_look_at():
    """A renamed base would empty the collection above silently."""
    assert {"Solid.closest", "Scene.closest", "Scene.move", "Scene.from_mesh", "Pose.inverse"} <= set(METHODS)
    assert set(FUNCTIONS) == {
        "from_mesh", "from_trimesh", "kernels_are_cached", "load", "open_publisher",
        "open_subscriber", "overlap", "serve", "start_service", "to_trimesh", "verify", "view",
        "warm_up",
    }  # fmt: skip


@pytest.mark.parametrize("name", CLASSES + FUNCTIONS + sorted(METHODS))
def test_public_name_begins_with_a_sentence(name):
    value = CALLABLES.get(name) or getattr(proximity, name)
    documentation = inspect.getdoc(value) or ""

    first = documentation.split("\n\n")[0]
    assert first and first[0].isupper(), f"{name}: {first!r}"
    assert first.rstrip().endswith((".", ":")), f"{name}: {first!r}"


@pytest.mark.parametrize("name", sorted(CALLABLES))
def test_public_function_documents_every_parameter_and_no_other(name):
    documentation = inspect.getdoc(CALLABLES[name])

    assert documented_parameters(documentation) == parameters_of(CALLABLES[name])


@pytest.mark.parametrize("name", CLASSES)
def test_public_class_documents_what_it_is_made_of(name):
    value = getattr(proximity, name)
    constructor = vars(value).get("__init__")
    if not inspect.isfunction(constructor) or hasattr(value, "__dataclass_fields__"):
        return

    assert documented_parameters(inspect.getdoc(value)) == parameters_of(constructor)


@pytest.mark.parametrize("name", CLASSES)
def test_public_class_says_what_its_attributes_are(name):
    """help() does not show comments in the source."""
    value = getattr(proximity, name)
    attributes = [own for own in vars(value).get("__annotations__", {}) if not own.startswith("_")]
    words = set(re.findall(r"\w+", inspect.getdoc(value)))

    assert set(attributes) <= words


@pytest.mark.parametrize("name", sorted(CALLABLES) + CLASSES)
def test_sections_are_known_and_in_order(name):
    documentation = inspect.getdoc(CALLABLES.get(name) or getattr(proximity, name))
    sections = sections_of(documentation)

    assert list(sections)[1:] == [title for title in SECTIONS if title in sections]
    keys = re.findall(r"^([A-Z][a-z ]+): ", sections.get("Notes", ""), flags=re.MULTILINE)
    assert keys == [key for key in NOTES_KEYS if key in keys]


@pytest.mark.parametrize("name", sorted(CALLABLES))
def test_functions_that_raise_say_so(name):
    """A raise in the function's own source reaches its callers."""
    source = inspect.getsource(CALLABLES[name])
    raised = set(re.findall(r"raise (\w+Error)\(", source))

    told = sections_of(inspect.getdoc(CALLABLES[name])).get("Raises", "")
    assert all(error in told for error in raised), f"{name} raises {raised}"


def test_every_module_says_why_it_exists():
    from test_layering import FILES

    for path in FILES.values():
        text = path.read_text(encoding="utf-8")
        assert text.startswith('"""') or not text.strip(), f"{path.name} has no docstring"
