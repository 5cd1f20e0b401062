"""The record of a contact: its layout, and the kernel's numbers for it."""

import numpy as np
import pytest

from proximity.kernels import contact_columns
from proximity.message import CONTACT, ContactFlag, Surface

FOUR_BYTES = {"finger", "flags", "part", "face", "work"}
ONE_BYTE = {"surface", "mode", "source", "force_is_valid"}


def test_record_is_little_endian_and_aligned():
    for name, (dtype, offset, *_) in CONTACT.fields.items():
        assert dtype.base.byteorder in "<|=", name
        assert offset % dtype.base.itemsize == 0, name
    assert CONTACT.itemsize == 328
    assert CONTACT.itemsize % 8 == 0
    assert sum(dtype.itemsize for dtype, *_ in CONTACT.fields.values()) == CONTACT.itemsize


@pytest.mark.parametrize("name", [name for name in CONTACT.names if name not in ONE_BYTE])
def test_kernels_write_where_the_record_has_the_field(name):
    size = 4 if name in FOUR_BYTES else 8

    assert getattr(contact_columns, f"RECORD_{name.upper()}") * size == CONTACT.fields[name][1]


def test_kinds_share_one_word_with_the_surface_lowest():
    assert [CONTACT.fields[name][1] for name in ("surface", "mode", "source", "force_is_valid")] == list(
        range(4 * contact_columns.RECORD_KINDS, 4 * contact_columns.RECORD_KINDS + 4)
    )
    assert 8 * contact_columns.RECORD_REALS == 4 * contact_columns.RECORD_INTS == CONTACT.itemsize


def test_flags_are_single_bits_and_surfaces_small_numbers():
    assert all(flag.bit_count() == 1 for flag in ContactFlag)
    assert np.uint8(Surface.DEFORMABLE) == 2
