"""The exception tree: what callers may catch."""

import inspect

import pytest

from proximity import errors

TREE = {
    "ProximityError": Exception,
    "MeshError": errors.ProximityError,
    "MeshFormatError": errors.MeshError,
    "NotWatertightError": errors.MeshError,
    "ArgumentError": errors.ProximityError,
    "PoseError": errors.ArgumentError,
    "FileError": errors.ProximityError,
    "MissingLibraryError": errors.ProximityError,
    "SceneError": errors.ProximityError,
    "RecordingError": errors.ProximityError,
    "PublishError": errors.ProximityError,
    "ServiceError": errors.ProximityError,
    "DecaffError": errors.ProximityError,
    "MotorError": errors.ProximityError,
    "UnitsWarning": UserWarning,
}
NOT_VALUES = {
    "FileError",
    "MissingLibraryError",
    "MotorError",
    "ProximityError",
    "PublishError",
    "UnitsWarning",
}


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
    """So that callers who do not know the package still catch what they expect."""
    assert issubclass(getattr(errors, name), ValueError)
