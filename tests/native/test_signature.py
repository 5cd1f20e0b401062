"""Signatures of entry points: declared types, and errors that name the mistake."""

from typing import NamedTuple

import numpy as np
import pytest

from proximity.native.signature import ANY_LENGTH, BUNDLES, Array, Scalar, bundle, signature


class Pair(NamedTuple):
    """A bundle of two arrays."""

    first: np.ndarray
    second: np.ndarray


def test_arguments_and_results_are_read_with_their_axes():
    found = signature("int, float64[:, 3], bool -> int64[:], float")

    assert found.arguments == (Scalar("int"), Array("float64", (ANY_LENGTH, 3)), Scalar("bool"))
    assert found.results == (Array("int64", (ANY_LENGTH,)), Scalar("float"))


def test_without_results_there_are_none():
    assert signature("int").results == ()


@pytest.mark.parametrize("text", ["float16[:]", "integer", "Unknown, int"])
def test_unknown_types_are_refused_by_name(text):
    with pytest.raises(ValueError, match="is no type of an argument"):
        signature(text)


def test_bundle_declares_every_field_in_order():
    with pytest.raises(ValueError, match=r"has the fields \('first', 'second'\), declared are \('second',\)"):
        bundle(Pair, second="int64[:]")
    assert "Pair" not in BUNDLES
