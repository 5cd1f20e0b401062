"""The public names: complete, sorted, documented, and imported lazily."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import proximity
from proximity.message import Kind


def as_ruff_sorts(name):
    """Return the sort key of ruff: constants, then classes, then functions."""
    return 0 if name.isupper() else 1 if name[0].isupper() else 2, name


def test_public_names_are_sorted():
    assert proximity.__all__ == sorted(proximity.__all__, key=as_ruff_sorts)


def test_type_checkers_of_users_read_the_annotations():
    """They ignore a package without this file (PEP 561): all its names would be Any."""
    assert (Path(proximity.__file__).parent / "py.typed").is_file()


def test_public_names_are_those_agreed():
    """Adding or removing one is a decision about versions: change this list too."""
    assert set(proximity.__all__) == {
        "ADDITIONS", "CHANGES", "CONNECTION", "CONTACT", "DEFORMATIONS", "FRAME", "GLOVE_POSES", "MEASURED",
        "MOVES", "NO_FACE", "NO_PART", "PATH_POSES", "POSES", "ArgumentError", "Clearance", "ClosestPoints",
        "ConnectionFlag", "ContactFlag", "DecaffError", "Feature", "FileError", "FileVersionError", "Gap",
        "LoadReport", "MeshError", "MeshFormatError", "Message", "MissingLibraryError", "Mode", "Motion",
        "MotionClearance", "MotorError", "NotWatertightError",
        "Overlap", "Part", "PartAction", "PartTracker", "Pose", "PoseError", "ProximityError",
        "PublishError", "Publisher", "RayCrossings", "RayHits", "Reading", "RecordingError", "Relation",
        "RunningPage", "RunningService", "Scene", "SceneError", "SegmentHits", "ServiceError", "SignMethod",
        "Solid",
        "Source", "State", "Subscriber", "Surface", "Thickness", "ThinWalls", "Tracker", "TriangleMesh",
        "UnitsWarning", "Verdict", "Verification", "VerifiedPair", "VerifiedRequirement", "from_mesh",
        "from_trimesh", "kernels_are_cached", "load", "open_publisher", "open_subscriber", "overlap",
        "serve", "start_service", "to_trimesh", "verify", "view", "warm_up",
    }  # fmt: skip


def test_every_error_is_public():
    from proximity import errors

    defined = {name for name, value in vars(errors).items() if inspect.isclass(value)}
    assert defined <= set(proximity.__all__)


@pytest.mark.parametrize("name", proximity.__all__)
def test_public_name_resolves_and_is_documented(name):
    value = getattr(proximity, name)

    if name.isupper():
        assert isinstance(value, int | np.dtype | Kind)
        return
    assert value.__name__ == name
    assert inspect.getdoc(value)
    for parameter in _parameters(value):
        assert parameter in inspect.getdoc(value), f"{name} does not document {parameter}"


def _parameters(value):
    """Return parameters of a function or a class's own __init__; records document fields in their body."""
    if inspect.isclass(value):
        if "__init__" not in vars(value) or hasattr(value, "__dataclass_fields__"):
            return []
        value = value.__init__
        if not inspect.isfunction(value):
            return []
    return [name for name in inspect.signature(value).parameters if name not in ("self", "args", "kwargs")]


@pytest.mark.parametrize(
    "name", [name for name in proximity.__all__ if name[0].isupper() and not name.isupper()]
)
def test_public_methods_document_every_parameter(name):
    value = getattr(proximity, name)

    for method_name, method in vars(value).items():
        function = getattr(method, "__func__", method)
        if method_name.startswith("_") or not inspect.isfunction(function):
            continue
        documentation = inspect.getdoc(function) or ""
        assert documentation, f"{name}.{method_name} has no docstring"
        for parameter in list(inspect.signature(function).parameters)[1:]:
            assert parameter in documentation, f"{name}.{method_name} does not document {parameter}"


def stub():
    """The stub read by type checkers."""
    return ast.parse(Path(proximity.__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body


def test_type_checkers_are_told_every_name():
    told = {
        alias.asname: (statement.module, alias.name)
        for statement in stub()
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }

    assert told == {name: (module, name) for name, module in proximity._MODULE_OF.items()}
    assert sorted(told) == sorted(proximity.__all__)


def test_type_checkers_of_users_take_our_types_and_find_misspelt_names():
    # Regression: without a marker the types of an installed package were ignored, and any name was valid.
    assert (Path(proximity.__file__).parent / "py.typed").read_bytes() == b""
    assert "__getattr__" not in {
        statement.name for statement in stub() if isinstance(statement, ast.FunctionDef)
    }


def test_dir_shows_the_public_names_only():
    assert set(dir(proximity)) == {*proximity.__all__, "__version__"}


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match=r"^module 'proximity' has no attribute 'distance'$"):
        _ = proximity.distance


@pytest.mark.processes
def test_importing_the_package_imports_nothing_heavy():
    code = (
        "import proximity, sys; "
        "print(sorted({'numpy', 'numba', 'scipy', 'trimesh', 'typer', 'rich'} & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )

    assert result.stdout == "[]\n"
