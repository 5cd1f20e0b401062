"""The envelope of messages: layout, numbers, checksum, and rejection of invalid bytes."""

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from proximity.errors import ArgumentError
from proximity.message import (
    FRAME,
    GLOVE_POSES,
    MAX_RECORDS,
    MEASURED,
    MOVES,
    PATH_POSES,
    POSES,
    PREFIX,
    VERSION,
    Defect,
    Message,
    parts_of,
    validate,
)
from proximity.message.fields import Field, dtype_of, reserved, struct_of

KINDS = [FRAME, POSES, PATH_POSES, GLOVE_POSES, MOVES, MEASURED]
SIZES = {
    "frame": (96, 328), "poses": (48, 72), "path_poses": (48, 1632), "glove_poses": (48, 128),
    "moves": (48, 216), "measured": (48, 152),
}  # fmt: skip


def some_message(kind=FRAME, count=3):
    message = Message(kind, count)
    rng = np.random.default_rng(count)
    message.records.view(np.uint8)[:] = rng.integers(0, 256, message.records.nbytes)
    return message


def as_array(data):
    return np.frombuffer(bytes(data), np.uint8)


def resealed(data):
    """Return the bytes with a valid checksum."""
    return data[:4] + struct.pack("<I", zlib.crc32(data[8:])) + data[8:]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_sizes_are_those_that_are_told(kind):
    assert (kind.header_size, kind.record_size) == SIZES[kind.name]
    assert kind.header_size % 8 == kind.record_size % 8 == 0
    assert kind.size(7) == kind.header_size + 7 * kind.record_size


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_fields_are_little_endian_aligned_and_without_gaps(kind):
    for dtype in (kind.header, kind.record):
        for name, (field, offset, *_) in dtype.fields.items():
            assert field.base.str[0] in "<|", name
            assert field.base.kind == "S" or offset % field.base.itemsize == 0, name
        assert sum(field.itemsize for field, *_ in dtype.fields.values()) == dtype.itemsize


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_headers_begin_alike(kind):
    for name, (field, offset) in PREFIX.fields.items():
        assert kind.header.fields[name] == (field, offset)
    assert kind.header["count"] == np.uint32
    assert kind.header[kind.sent] == np.int64


def test_kinds_are_told_apart():
    assert len({kind.magic for kind in KINDS}) == len(KINDS)
    assert all(kind.magic.to_bytes(4, "little").startswith(b"DEC") for kind in KINDS)


def test_struct_reads_what_the_dtype_says():
    fields = [Field("a", "<u1", "", ""), reserved(3), Field("b", "<i4", "", ""), Field("c", "<u8", "", "")]
    record = np.zeros((), dtype_of(fields))
    record["a"], record["b"], record["c"], record["reserved"] = 200, -5, 2**64 - 1, 9

    assert struct_of(fields).unpack(record.tobytes()) == (200, -5, 2**64 - 1)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("count", [0, 1, 5, MAX_RECORDS])
def test_sealed_message_has_no_flaw_and_its_parts_are_found(kind, count):
    message = some_message(kind, count)
    data = message.seal(12345, 2**64 - 1)

    assert validate(data, kind) is None
    header, records = parts_of(data, kind)
    assert (header["session"], header["sequence"], header["count"]) == (12345, 2**64 - 1, count)
    assert (header["version"], header["size"]) == (VERSION, len(data))
    assert records.tobytes() == message.records.tobytes()


@pytest.mark.parametrize("count", [-1, 1.5])
def test_message_that_cannot_have_as_many_records_is_refused(count):
    with pytest.raises(ArgumentError, match=f"^{count} records, expected 0 to {MAX_RECORDS}$"):
        Message(FRAME, count)


def test_every_flipped_bit_is_seen():
    data = some_message(POSES, 1).seal(1, 2).tobytes()
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        assert validate(as_array(damaged), POSES) is not None, bit


def test_every_truncation_is_seen():
    data = some_message(POSES, 2).seal(1, 2).tobytes()
    for size in range(len(data)):
        expected = Defect.SHORT if size < POSES.header_size else Defect.SIZE
        assert validate(as_array(data[:size]), POSES) is expected


@pytest.mark.parametrize(
    ("change", "defect"),
    [
        (lambda data: data[:95], Defect.SHORT),
        (lambda data: b"DECX" + data[4:], Defect.MAGIC),
        (lambda data: resealed(data[:8] + b"\1\0" + data[10:]), Defect.VERSION),
        (lambda data: resealed(data[:10] + b"\x38\0" + data[12:]), Defect.SIZE),  # another header
        (lambda data: resealed(data + b"\0"), Defect.SIZE),
        (lambda data: resealed(data[:-328]), Defect.SIZE),
        (lambda data: resealed(data[:12] + struct.pack("<I", 2**32 - 1) + data[16:]), Defect.SIZE),
        (lambda data: resealed(data[:88] + struct.pack("<I", 2) + data[92:]), Defect.SIZE),  # another count
        (lambda data: data[:-1] + b"\7", Defect.CHECKSUM),
        (lambda data: data[:4] + b"\0\0\0\0" + data[8:], Defect.CHECKSUM),
    ],
)
def test_what_is_no_frame_is_told_why(change, defect):
    data = some_message().seal(1, 2).tobytes()

    assert validate(as_array(change(data)), FRAME) is defect


def test_frame_with_too_many_contacts_is_refused():
    count = MAX_RECORDS + 1
    data = bytearray(FRAME.size(count))
    header = np.frombuffer(data, FRAME.header, count=1)
    header["magic"], header["version"], header["header_size"] = FRAME.magic, VERSION, FRAME.header_size
    header["size"], header["count"] = len(data), count

    assert validate(as_array(resealed(bytes(data))), FRAME) is Defect.SIZE


@given(st.binary(max_size=600), st.sampled_from(KINDS))
def test_no_bytes_raise(data, kind):
    assert isinstance(validate(as_array(data), kind), Defect)


@given(st.binary(max_size=700), st.sampled_from(KINDS))
def test_no_bytes_behind_a_good_beginning_raise(body, kind):
    message = Message(kind, 0)
    data = message.seal(1, 1).tobytes()[:32] + body
    defect = validate(as_array(resealed(data)), kind)

    assert defect in (Defect.SHORT, Defect.SIZE, None)
    assert (defect is None) == (len(data) == kind.header_size and data[kind.count_at :][:4] == b"\0" * 4)
