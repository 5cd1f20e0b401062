"""The record of a contact: its layout, and the kernel's numbers for it."""

import numpy as np

from proximity.kernels import contact_record
from proximity.message import CONTACT, ContactFlag, Surface


def test_record_is_little_endian_and_aligned():
    for name, (dtype, offset, *_) in CONTACT.fields.items():
        assert dtype.base.byteorder in "<|=", name
        assert offset % dtype.base.itemsize == 0, name
    assert CONTACT.itemsize == 328
    assert CONTACT.itemsize % 8 == 0
    assert sum(dtype.itemsize for dtype, *_ in CONTACT.fields.values()) == CONTACT.itemsize


def test_kernels_write_the_record_that_is_documented():
    assert contact_record.CONTACT_RECORD == CONTACT


def test_flags_are_single_bits_and_surfaces_small_numbers():
    assert all(flag.bit_count() == 1 for flag in ContactFlag)
    assert np.uint8(Surface.DEFORMABLE) == 2
