"""Tables of messages and enumerations, generated from the declarations of the messages."""

from proximity.message import Message
from proximity.message.c_header import ENUMS, KINDS, RECORDS, c_type, meanings_of
from proximity.message.envelope import PREFIX_FIELDS
from proximity.message.fields import dtype_of
from proximity.message.inputs import POSE_FIELDS

TITLES = {
    "prefix": ("Beginning of every message", "", ()),
    "frame_header": ("Header of a frame", "After the beginning of every message.", PREFIX_FIELDS),
    "contact": ("Contact", "One finger of a frame.", ()),
    "input_header": (
        "Header of a message to a service", "After the beginning of every message.", PREFIX_FIELDS,
    ),
    "pose": ("Pose", "One finger of a `poses` message.", ()),
    "path_pose": ("Pose with a path", "One finger of a `path_poses` message: a pose, then", POSE_FIELDS),
    "glove_pose": ("Pose of a glove", "One finger of a `glove_poses` message.", ()),
    "move": ("Move", "One part of a `moves` message.", ()),
    "measurement": ("Measurement", "One finger of a `measured` message.", ()),
    "change": ("Change", "One part of a `changes` message.", ()),
    "addition": ("Addition", "One file of an `additions` message.", ()),
    "deformation": ("Deformation", "Up to 64 vertices of the one part of a `deformations` message.", ()),
    "description_header": (
        "Header of a description", "After the beginning of every message.", PREFIX_FIELDS,
    ),
    "label": ("Name", "One part or finger of a `description`.", ()),
}  # fmt: skip
"""Title, description and preceding fields of each header and record."""


def records():
    """Return the kinds, the layout of every header and record, and examples with checksums, as Markdown."""
    return "\n\n".join(["## Layouts", _kinds(), *map(_record, RECORDS), _vectors()]) + "\n"


def enum_table(name):
    """Return the members of an enumeration, with their meanings."""
    meanings = meanings_of(ENUMS[name])
    rows = [
        f"| `{member.name}` | {int(member)} | {meanings[member.name].replace('``', '`')} |"
        for member in ENUMS[name]
    ]
    return "\n".join(["| name | value | meaning |", "|---|---|---|", *rows])


def example(kind):
    """Return a message of one record, filled from the table of examples, and sealed."""
    message = Message(kind, 1)
    message.header[kind.sent] = 3
    if "name" in kind.record.names:
        message.records["name"] = b"lid"
    for name, (field, _) in kind.record.fields.items():
        if field.base.kind == "f":
            message.records[name] = 0.5
    message.seal(1, 2)
    return message


def _kinds():
    rows = [
        f"| `{kind.name}` | `0x{kind.magic:08x}` | {kind.header_size} | {kind.record_size} |"
        for kind in KINDS
    ]
    return "\n".join(
        [
            "| kind | magic | bytes of the header | bytes of each record |",
            "|---|---|---:|---:|",
            *rows,
        ]
    )


def _record(name):
    _, fields = RECORDS[name]
    title, sentence, known = TITLES[name]
    offsets = dtype_of(fields).fields
    rows = [
        f"| {offsets[field.name][1]} | `{field.name}` | `{c_type(field)}` | {field.unit} | {field.meaning} |"
        for field in fields
        if field not in known
    ]
    table = "\n".join(["| at byte | field | type | unit | meaning |", "|---:|---|---|---|---|", *rows])
    return "\n\n".join(filter(None, [f"### {title}", sentence, table]))


def _vectors():
    rows = [
        f"| `{kind.name}` | {len(message.data)} | `0x{int(message.header['checksum']):08x}` |"
        for kind in KINDS
        for message in [example(kind)]
    ]
    return "\n".join(
        [
            "## Examples with their checksums",
            "",
            "Try a program of your own with these. Each message has one record, session 1, sequence 2,",
            "and 3 as `publish_ns` or `send_ns`. The name is `lid` where a record has one, each double is",
            "0.5, and all else but `count` is zero.",
            "",
            "| message | bytes | checksum |",
            "|---|---:|---|",
            *rows,
        ]
    )
