"""One frame as plain values, for ``proximity watch --json``: SI units, names instead of numbers."""

from collections.abc import Iterable, Sequence
from enum import IntEnum, IntFlag
from typing import Any

from proximity.message import ContactFlag, Mode, Source, State, Surface

HEADER_FIELDS = (
    "session", "sequence", "pose_ns", "start_ns", "publish_ns", "valid_until_ns", "period_ns", "epoch",
    "missed",
)  # fmt: skip
NAMED: dict[str, type[IntEnum]] = {"mode": Mode, "surface": Surface, "source": Source}


def frame_document(frame: Any, part_names: Sequence[str]) -> dict[str, Any]:
    """Return a frame as plain values: fields of its header, and of the contact of each finger.

    *part_names*: of the parts that ``part`` counts; empty where they are not known, then ``part_name`` is
    null.
    """
    header = frame["header"]
    return {
        "state": _name(State, header["state"]),
        **{field: header[field].item() for field in HEADER_FIELDS},
        "fingers": [_finger(contact, part_names) for contact in frame["contacts"]],
    }


def _finger(contact: Any, part_names: Sequence[str]) -> dict[str, Any]:
    assert contact.dtype.names is not None
    fields = {field: contact[field].tolist() for field in contact.dtype.names}
    fields |= {field: _name(kind, fields[field]) for field, kind in NAMED.items()}
    part = fields["part"]
    return fields | {
        "flags": list(_names(ContactFlag, fields["flags"])),
        "force_is_valid": bool(fields["force_is_valid"]),
        "part_name": part_names[part] if 0 <= part < len(part_names) else None,
    }


def _name(kind: type[IntEnum], number: Any) -> str:
    """The name of a member; the number where a newer publisher has one that is not known here."""
    return kind(number).name.lower() if number in set(kind) else str(number)


def _names(kind: type[IntFlag], bits: int) -> Iterable[str]:
    return (str(flag.name).lower() for flag in kind if bits & flag)
