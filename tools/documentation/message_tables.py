"""Tables of messages and of their words, made of the tables that the messages themselves are made of."""

from proximity.message import Message
from proximity.message.c_header import ENUMS, KINDS, RECORDS, c_type, meanings_of
from proximity.message.envelope import PREFIX_FIELDS

TITLES = {
    "prefix": "Every message begins with",
    "frame_header": "The header of a frame goes on with",
    "contact": "A contact",
    "input_header": "The header of what a service is fed with goes on with",
    "pose": "A finger of a `poses` message",
    "path_pose": "A finger of a `path_poses` message is a pose and",
    "glove_pose": "A finger of a `glove_poses` message",
    "move": "A part of a `moves` message",
    "measurement": "A finger of a `measured` message",
    "change": "A part of a `changes` message",
    "addition": "A file of an `additions` message",
    "deformation": "Up to 64 vertices of the one part of a `deformations` message",
    "description_header": "The header of a `description` goes on with",
    "label": "A part or finger of a `description`",
}


def records():
    """The layout of every header and record, and examples with their checksums, as Markdown."""
    return "\n\n".join([*map(_record, RECORDS), _vectors()]) + "\n"


def enum_table(name):
    """The members of an enumeration, with what they mean."""
    meanings = meanings_of(ENUMS[name])
    rows = [
        f"| `{member.name}` | {int(member)} | {meanings[member.name].replace('``', '`')} |"
        for member in ENUMS[name]
    ]
    return "\n".join(["| name | value | meaning |", "|---|---|---|", *rows])


def example(kind):
    """A message of one record, filled as the table of examples says, and sealed."""
    message = Message(kind, 1)
    message.header[kind.sent] = 3
    if "name" in kind.record.names:
        message.records["name"] = b"lid"
    for name, (field, _) in kind.record.fields.items():
        if field.base.kind == "f":
            message.records[name] = 0.5
    message.seal(1, 2)
    return message


def _record(name):
    _, fields = RECORDS[name]
    known = RECORDS["pose"][1] if name == "path_pose" else PREFIX_FIELDS if name != "prefix" else ()
    rows = [
        f"| `{field.name}` | `{c_type(field)}` | {field.unit} | {field.meaning} |"
        for field in fields
        if field not in known
    ]
    return "\n".join([f"| {TITLES[name]} | type | unit | |", "|---|---|---|---|", *rows])


def _vectors():
    rows = [
        f"| `{kind.name}` | {len(message.data)} | `0x{int(message.header['checksum']):08x}` |"
        for kind in KINDS
        for message in [example(kind)]
    ]
    return "\n".join(
        [
            "To try a program of your own: a message of one record, with session 1, sequence 2, "
            "`publish_ns` or `send_ns` 3, the",
            "name `lid` where a record has a name, 0.5 for each double, and zeros for all else but `count`.",
            "",
            "| Such a message | bytes | checksum |",
            "|---|---|---|",
            *rows,
        ]
    )
