"""The tables of fields in docs/message.md, made of the tables of the messages: run this to have them anew.

What it prints is the end of that page; a test compares.
"""

from proximity.message.c_header import ENUMS, RECORDS, c_type, meanings_of
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
}
ENUM_TITLES = {
    "flag": "`ContactFlag`, bits of `flags`",
    "state": "`State`",
    "source": "`Source`",
    "surface": "`Surface`",
    "mode": "`Mode`",
}


def tables():
    """The text of all tables, as Markdown."""
    return "\n\n".join([*map(_record, RECORDS), *map(_enum, ENUMS)]) + "\n"


def _record(name):
    _, fields = RECORDS[name]
    known = RECORDS["pose"][1] if name == "path_pose" else PREFIX_FIELDS if name != "prefix" else ()
    rows = [
        f"| `{field.name}` | {c_type(field)} | {field.unit} | {field.meaning} |"
        for field in fields
        if field not in known
    ]
    return "\n".join([f"| {TITLES[name]} | type | unit | |", "|---|---|---|---|", *rows])


def _enum(name):
    meanings = meanings_of(ENUMS[name])
    rows = [
        f"| `{member.name}` | {int(member)} | {meanings[member.name].replace('``', '`')} |"
        for member in ENUMS[name]
    ]
    return "\n".join([f"| {ENUM_TITLES[name]} | | |", "|---|---|---|", *rows])


if __name__ == "__main__":
    print(tables(), end="")
