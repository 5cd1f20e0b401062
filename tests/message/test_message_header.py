"""``proximity_message.h``, compiled, against NumPy and the corresponding Python code."""

import ctypes
import hashlib
import socket
import zlib

import numpy as np
import pytest
from compiling_c import WARNINGS, c_compiler, compiler, run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ports import free_port
from wire import KNOWN, MS, NOW, Clock, Wire, frame, sealed

from proximity.core import receiver_state
from proximity.core.receiver_state import LIMITS
from proximity.message import CONTACT, FRAME, POSES, Defect, Message, State, c_header, validate
from proximity.message.c_header import ENUMS, KINDS, RECORDS, header_text, meanings_of, record_name
from proximity.message.fields import dtype_of
from proximity.transport import Subscriber, open_inlet, widen
from proximity.transport.message_key import write_key
from proximity.transport.publisher_clock import ForeignClock
from proximity.transport.subscriber import STALE_AFTER

FLAWS = [None, *Defect]
FINITE = st.floats(-10, 10)

LIBRARY = """
#include "proximity_message.h"
uint32_t crc32_of(const void *data, size_t size) { return proximity_crc32(data, size); }
int check_frame(const void *data, size_t size) { return (int)proximity_check_frame(data, size); }
int check_poses(const void *data, size_t size)
{
    return (int)proximity_check(data, size, PROXIMITY_POSES_MAGIC, sizeof(proximity_input_header),
                                sizeof(proximity_finger_pose), offsetof(proximity_input_header, count));
}
void seal_poses(void *data, size_t size, uint64_t session, uint64_t sequence)
{
    proximity_seal(data, size, PROXIMITY_POSES_MAGIC, sizeof(proximity_input_header), session, sequence);
}
int content_flaw(const proximity_frame_header *frame, int64_t base)
{
    return (int)proximity_content_flaw(frame, frame + 1, base);
}
int state_at(const void *data, int64_t now)
{
    return (int)proximity_state_at(data, now, PROXIMITY_STALE_AFTER_NS);
}
double lower_at(const void *data, int64_t now, double speed, double acceleration)
{
    return proximity_lower_at(data, now, speed, acceleration);
}
void tag_of(const void *key, const void *data, size_t size, void *tag)
{
    proximity_tag(key, data, size, tag);
}
size_t verified(const void *key, const void *data, size_t size)
{
    return proximity_verified(key, data, size);
}
int key_of_text(const char *text, void *key) { return proximity_key_of_text(text, key); }
static proximity_clock heard;
void clock_reset(void) { memset(&heard, 0, sizeof heard); }
void clock_hear(uint64_t session, int64_t sent, int64_t now)
{
    proximity_clock_hear(&heard, session, sent, now);
}
int64_t clock_theirs(int64_t now) { return proximity_clock_theirs(&heard, now); }
int clock_is_certain(void) { return heard.is_certain != 0; }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("header")
    (folder / "proximity_message.h").write_text(header_text(), encoding="ascii")
    return folder


whole, size, real, text, pointer = (
    ctypes.c_int64, ctypes.c_size_t, ctypes.c_double, ctypes.c_char_p, ctypes.c_void_p,
)  # fmt: skip
FUNCTIONS = {
    "crc32_of": (ctypes.c_uint32, text, size), "check_frame": (ctypes.c_int, text, size),
    "check_poses": (ctypes.c_int, text, size),
    "seal_poses": (None, pointer, size, ctypes.c_uint64, ctypes.c_uint64),
    "tag_of": (None, text, text, size, text), "verified": (size, text, text, size),
    "key_of_text": (ctypes.c_int, text, text), "content_flaw": (ctypes.c_int, pointer, whole),
    "state_at": (ctypes.c_int, pointer, whole), "lower_at": (real, pointer, whole, real, real),
    "clock_hear": (None, ctypes.c_uint64, whole, whole), "clock_theirs": (whole, whole),
}  # fmt: skip


@pytest.fixture(scope="module")
def library(folder):
    """The functions of the header."""
    (folder / "library.c").write_text(LIBRARY, encoding="ascii")
    target = folder / "library.so"
    run(
        c_compiler(),
        "-std=c99",
        *WARNINGS,
        "-O1",
        "-shared",
        "-fPIC",
        folder / "library.c",
        "-lm",
        "-o",
        target,
    )
    loaded = ctypes.CDLL(str(target))
    for name, (result, *arguments) in FUNCTIONS.items():
        function = getattr(loaded, name)
        function.restype, function.argtypes = result, arguments
    return loaded


def printed(folder, name, lines):
    """Run a program of these statements; return its output as lines of words."""
    source = folder / f"{name}.c"
    body = "\n".join(["#include <stdio.h>", '#include "proximity_message.h"', "int main(void)", "{", *lines])
    source.write_text(f"{body}\nreturn 0;\n}}\n", encoding="ascii")
    run(c_compiler(), "-std=c99", *WARNINGS, source, "-lm", "-o", folder / name)
    return [line.split() for line in run(folder / name).splitlines()]


def test_every_size_and_offset_is_that_of_numpy(folder):
    lines, expected = [], []
    for name, (_, fields) in RECORDS.items():
        lines.append(f'printf("{name} . %zu 0\\n", sizeof({record_name(name)}));')
        expected.append([name, ".", str(dtype_of(fields).itemsize), "0"])
        for field, (part, offset) in dtype_of(fields).fields.items():
            place = f"sizeof((({record_name(name)} *)0)->{field}), offsetof({record_name(name)}, {field})"
            lines.append(f'printf("{name} {field} %zu %zu\\n", {place});')
            expected.append([name, field, str(part.itemsize), str(offset)])
    assert printed(folder, "layout", lines) == expected


def test_every_number_is_that_of_python(folder):
    expected = {f"PROXIMITY_{kind.name.upper()}_MAGIC": kind.magic for kind in KINDS}
    for name, values in ENUMS.items():
        expected |= {f"PROXIMITY_{name.upper()}_{member.name}": int(member) for member in values}
    expected |= {f"PROXIMITY_FLAW_{defect.name}": number for number, defect in enumerate(Defect, 1)}
    expected |= {f"PROXIMITY_{name}": value for name, value in LIMITS.items() if isinstance(value, int)}
    assert LIMITS["STALE_AFTER_NS"] == round(1e9 * STALE_AFTER)
    lines = [f'printf("{name} %lld\\n", (long long){name});' for name in expected]
    assert printed(folder, "numbers", lines) == [[name, str(number)] for name, number in expected.items()]


@pytest.mark.parametrize("standard", ["c99", "c17", "c++11", "c++17"])
def test_header_compiles_without_a_warning(folder, standard):
    is_cpp = "++" in standard
    source = folder / ("empty.cpp" if is_cpp else "empty.c")
    body = 'int main(void) { return proximity_check_frame("", 0) == 0; }\n'
    source.write_text(f'#include "proximity_message.h"\n{body}')
    program = compiler("c++", "g++", "clang++") if is_cpp else c_compiler()
    more = [] if is_cpp else ["-Wconversion", "-Wshadow"]
    run(program, f"-std={standard}", *WARNINGS, *more, "-fsyntax-only", source)


def test_compiler_holds_the_layout(folder):
    source = folder / "moved.c"
    text = header_text().replace("double lower;", "float lower;")
    source.write_text(text + "int main(void) { return 0; }\n")

    with pytest.raises(AssertionError, match=r"static assertion failed|static_assert failed"):
        run(c_compiler(), "-std=c11", "-fsyntax-only", source)


def test_every_field_is_told_with_unit_and_meaning():
    for name, (what, fields) in RECORDS.items():
        assert what.endswith("."), name
        for field in fields:
            assert field.meaning and not field.meaning.endswith("."), (name, field.name)
            has_number = field.type == "<f8" and field.name not in ("normal", "rotation")
            is_bend = "bend" in field.name and not field.name.endswith("rate")
            assert bool(field.unit) == (has_number and not is_bend) or field.type != "<f8", (name, field.name)
            assert (field.unit == "ns") == (field.name.endswith("_ns") or field.name == "session")


def test_meanings_of_members_are_those_of_the_source():
    assert meanings_of(State)["STALE"] == "The newest frame is too old, or none came: the state is unknown."
    for name, values in ENUMS.items():
        meanings = meanings_of(values)
        assert list(meanings) == list(values.__members__)
        assert all(meanings.values()) or name == "surface"


@given(st.binary(max_size=2000))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_checksum_is_that_of_zlib(library, data):
    assert library.crc32_of(data, len(data)) == zlib.crc32(data)


@given(st.binary(max_size=400), st.booleans(), st.sampled_from([FRAME, POSES]), st.integers(0, 400))
def test_flaws_are_those_of_python(library, noise, has_checksum, kind, at):
    message = Message(kind, 1)
    data = bytearray(message.seal(1, 2).tobytes())
    data[at : at + len(noise) // 20] = noise[: len(noise) // 20]
    if has_checksum and len(data) >= 8:
        data[4:8] = zlib.crc32(data[8:]).to_bytes(4, "little")
    check = library.check_frame if kind is FRAME else library.check_poses
    for candidate in (bytes(data), bytes(data[: at + 1]), bytes(noise), bytes(data) + noise):
        defect = validate(np.frombuffer(candidate, np.uint8), kind)
        assert FLAWS[check(candidate, len(candidate))] is defect


@pytest.mark.parametrize("count", [0, 2**32 - 1])
def test_count_that_does_not_fit_is_seen(library, count):
    data = bytearray(sealed(frame(count=1)))
    data[88:92] = count.to_bytes(4, "little")
    data[4:8] = zlib.crc32(data[8:]).to_bytes(4, "little")

    assert FLAWS[library.check_frame(bytes(data), len(data))] is Defect.SIZE


def test_what_c_seals_has_no_flaw(library):
    data = Message(POSES, 3).data
    data[:40] = 0
    library.seal_poses(data.ctypes.data, len(data), 2**63 + 5, 2**64 - 1)

    assert validate(data, POSES) is None
    assert data[16:32].view("<u8").tolist() == [2**63 + 5, 2**64 - 1]


KEYS = [bytes(32), bytes(range(32)), hashlib.sha256(b"another key").digest()]


def tag_in_c(library, key, data):
    tag = ctypes.create_string_buffer(16)
    library.tag_of(key, data, len(data), tag)
    return tag.raw


@pytest.mark.parametrize("key", KEYS)
def test_tag_is_that_of_hashlib(library, key):
    """All lengths up to the fourth block, and those of messages."""
    data = np.random.default_rng(7).bytes(70_000)
    for size in [*range(301), 408, 1736, 2**16 - 1, 2**16, 65_491]:
        expected = hashlib.blake2s(data[:size], key=key, digest_size=16).digest()
        assert tag_in_c(library, key, data[:size]) == expected, size


@pytest.mark.parametrize("size", [1, 64, 65, 1736])
def test_what_is_not_as_it_was_tagged_is_not_verified(library, size):
    key, data = KEYS[1], np.random.default_rng(size).bytes(size)
    datagram = data + tag_in_c(library, key, data)

    assert library.verified(key, datagram, len(datagram)) == size
    for at in {0, size // 2, size - 1, size, size + 15}:
        changed = datagram[:at] + bytes([datagram[at] ^ 0x80]) + datagram[at + 1 :]
        assert library.verified(key, changed, len(changed)) == 0
    for cut in (0, 1, 15, 16, len(datagram) - 1):
        assert library.verified(key, datagram, cut) == 0
    assert library.verified(KEYS[2], datagram, len(datagram)) == 0


@pytest.mark.parametrize(
    ("text", "is_key"),
    [
        ("00ff" * 16, True), ("Ab" * 32 + "\n", True), ("ab" * 32 + "\r\n", True), ("ab" * 31, False),
        ("ab" * 32 + "a", False), ("ag" * 32, False), ("a b" * 22, False), ("", False), ("\xff" * 64, False),
    ],
)  # fmt: skip
def test_key_is_read_from_its_text(library, text, is_key):
    key = ctypes.create_string_buffer(32)

    assert bool(library.key_of_text(text.encode("latin-1"), key)) is is_key
    if is_key:
        assert key.raw == bytes.fromhex(text)


def test_what_c_seals_and_tags_is_taken_over_udp(library, tmp_path):
    """A program in C may send poses."""
    path, message = tmp_path / "poses.key", Message(POSES, 2)
    write_key(str(path))
    port = free_port()
    library.seal_poses(message.data.ctypes.data, len(message.data), 5, 0)
    sealed_bytes, room = message.data.tobytes(), np.zeros(500, np.uint8)
    inlet = open_inlet(f"udp://127.0.0.1:{port}?key={path}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        key = bytes.fromhex(path.read_text())
        sender.sendto(sealed_bytes + tag_in_c(library, key, sealed_bytes), ("127.0.0.1", port))
        assert inlet.wait(20.0)
        size = inlet.receive(room)
    inlet.close()

    assert room[:size].tobytes() == sealed_bytes


@given(
    st.sampled_from(list(State)),
    st.integers(0, 3000 * MS),
    st.sampled_from([0, 5 * MS, 20 * MS, 5000 * MS, 2**62]),
)
def test_states_are_those_of_a_subscriber(library, state, later, valid_for):
    message, wire, clock = frame(state=state, valid_for=valid_for), Wire(), Clock()
    wire.put(sealed(message))
    subscriber = Subscriber(wire, "wire:", clock=clock)
    subscriber.read()
    clock.now += later

    assert library.state_at(message.data.ctypes.data, clock.now) == subscriber.read().state


VALUES = st.one_of(FINITE, st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e-9]))


@given(
    st.lists(VALUES, min_size=6, max_size=6),
    st.lists(st.floats(-0.1, 0.2), min_size=4, max_size=4),
    st.booleans(),
    st.booleans(),
    st.integers(-MS, 5 * MS),
    st.integers(0, 100 * MS),
    VALUES,
)
def test_lower_bounds_are_those_of_python(
    library, velocities, bounds, is_predicted, is_geometry, ahead, later, approach
):
    contacts = frame(count=1).records.copy()
    contact = contacts[0]
    contact["velocity"], contact["part_velocity"] = velocities[:3], velocities[3:]
    contact["lower"], contact["upper"] = sorted(bounds[:2])
    contact["predicted_lower"], contact["predicted_upper"] = sorted(bounds[2:])
    contact["approach_speed"], contact["source"] = approach, not is_geometry
    contact["flags"] = KNOWN if is_predicted else 1
    contact["predicted_ns"] = contact["pose_ns"] + ahead
    now = int(contact["pose_ns"]) + later
    told = library.lower_at(contacts.ctypes.data, now, 2.5, 100.0)
    widen(contacts, now, 2.5, 100.0)

    np.testing.assert_allclose(told, contacts["lower"][0], rtol=1e-9, atol=1e-12)


@given(
    st.lists(
        st.tuples(st.integers(-2000 * MS, 2000 * MS), st.integers(0, 90 * MS), st.sampled_from([0, 0, 0, 1])),
        min_size=1,
        max_size=30,
    )
)
def test_clock_is_that_of_python(library, steps):
    """Messages with random intervals between sending and arrivals; some begin a new run."""
    library.clock_reset()
    clock, sent, now, session = ForeignClock(), NOW, 0, 2**63
    for sent_later, now_later, begun in steps:
        sent, now, session = sent + sent_later, now + now_later, session + begun
        library.clock_hear(session, sent, now)
        clock.arrived(sent, now, is_new_run=bool(begun))
        assert bool(library.clock_is_certain()) is clock.is_certain
        assert library.clock_theirs(now) == pytest.approx(clock.theirs(now), abs=2)


@given(
    st.lists(
        st.tuples(
            st.integers(1, 150),
            st.sampled_from([MS, 11 * MS, 20 * MS]),
            st.one_of(st.just(0), st.integers(-1500 * MS, 1500 * MS)),
            st.booleans(),
            st.sampled_from([0, 0, 1]),
        ),
        min_size=1,
        max_size=10,
    )
)
def test_clock_is_that_of_python_after_mistakes_and_restarts(library, rows):
    """Series of messages of which the first, or all, have a wrong timestamp."""
    library.clock_reset()
    clock, now, session = ForeignClock(), 0, 2**63
    for count, period, wrong, is_for_good, begun in rows:
        session += begun
        for number in range(count):
            now += period
            sent = now + NOW + (wrong if is_for_good or number == 0 else 0)
            library.clock_hear(session, sent, now)
            clock.arrived(sent, now, is_new_run=bool(begun) and number == 0)
            assert bool(library.clock_is_certain()) is clock.is_certain
            assert library.clock_theirs(now) == clock.theirs(now)


@pytest.mark.parametrize(
    ("part", "name", "value", "defect"),
    [
        ("records", "lower", 0.051, Defect.CONTENT), ("records", "upper", np.nan, Defect.CONTENT),
        ("records", "signed_distance", np.nan, Defect.CONTENT),
        ("records", "pose_ns", NOW - 2 * MS, Defect.CONTENT),
        ("records", "pose_ns", NOW + 5 * MS + 1, Defect.CONTENT), ("header", "state", 6, Defect.CONTENT),
        ("header", "source", 3, Defect.CONTENT), ("header", "pose_ns", -1, Defect.CONTENT),
        ("header", "pose_ns", NOW + 5 * MS + 1, Defect.FUTURE),
        ("header", "publish_ns", NOW + 5 * MS + 1, Defect.FUTURE),
    ],
)  # fmt: skip
def test_frame_without_sense_is_seen(library, part, name, value, defect):
    message = frame()
    data = message.data.ctypes.data
    assert library.content_flaw(data, NOW) == 0
    getattr(message, part)[name][... if part == "header" else 4] = value
    assert FLAWS[library.content_flaw(data, NOW)] is defect
    if part == "records":
        message.records["flags"][4] = 0
        assert library.content_flaw(data, NOW) == 0


def test_state_of_a_receiver_is_that_of_numpy(folder):
    lines, expected = [], []
    for name, record in receiver_state.RECORDS.items():
        lines.append(f'printf("{name} . %zu 0\\n", sizeof({name}));')
        expected.append([name, ".", str(record.itemsize), "0"])
        for field, (part, offset) in record.fields.items():
            place = f"sizeof((({name} *)0)->{field}), offsetof({name}, {field})"
            lines.append(f'printf("{name} {field} %zu %zu\\n", {place});')
            expected.append([name, field, str(part.itemsize), str(offset)])
    assert printed(folder, "state", lines) == expected


def test_contact_of_the_header_is_the_one_of_python():
    assert dtype_of(RECORDS["contact"][1]) == CONTACT
    assert c_header.RECORDS.keys() == {
        "prefix", "frame_header", "contact", "input_header", "pose", "path_pose", "glove_pose", "move",
        "measurement", "change", "addition", "deformation", "description_header", "label",
    }  # fmt: skip
