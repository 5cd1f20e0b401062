"""Record of the contact of one finger at a tick, as stored, logged and published.

One record is `CONTACT`. Kernels write the type `kernels.contact_record`; a test compares both.
"""

import operator
from collections.abc import Iterator
from enum import IntEnum, IntFlag
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np

from proximity.checks import shown_number
from proximity.kernels import contact_record
from proximity.message.fields import VECTOR, Field, dtype_of


class ContactFlag(IntFlag):
    """State of a finger's answer at this tick; a set of bits in ``contacts["flags"]``."""

    TRACKED = contact_record.TRACKED
    """The finger had a position at this tick. Otherwise the bounds are -inf and inf."""
    PREDICTED = contact_record.PREDICTED
    """The velocity is known, so that predictions and times to contact are valid."""
    EXACT = contact_record.EXACT
    """lower = signed_distance = upper."""
    BOUNDED = contact_record.BOUNDED
    """The work budget was exhausted, or a part moves and its pose is of another instant: the bounds hold, the
    distance is the nearest surface found."""
    SKIPPED = contact_record.SKIPPED
    """No search was made: the finger is outside the working range, within the tolerance, or the budget of all
    fingers was exhausted. The bounds follow from the last search and from the motion of finger and parts
    since."""
    SIGNED = contact_record.SIGNED
    """Inside or outside is known. Otherwise the distance has no sign, because the nearest part has no
    inside."""
    INSIDE = contact_record.INSIDE
    """The centre of the fingertip is inside a part."""
    IN_RANGE = contact_record.IN_RANGE
    """The distance is within the working range."""
    PART_CHANGED = contact_record.PART_CHANGED
    """The nearest part is not the one of the tick before: the closest point may have jumped."""
    JUMPED = contact_record.JUMPED
    """The pose is farther from the previous one than a hand can move, or of an earlier instant. The velocity
    is reset; after a jump of one or two poses it continues."""
    ON_PATH = contact_record.ON_PATH
    """The predicted contact is on the given path. The time to contact is as well, if the finger is closing
    (``bend_rate`` is positive)."""
    CONTACT_FOUND = contact_record.CONTACT_FOUND
    """The position of the contact on the path is confirmed within ``contact_bend_error``."""

    @classmethod
    def _missing_(cls, value: Any) -> Any:
        """Return the flags of a number. This also accepts the NumPy integer of a record."""
        return super()._missing_(operator.index(value))


TRACKED_BIT, PREDICTED_BIT, BOUNDED_BIT = (
    np.uint32(flag) for flag in (ContactFlag.TRACKED, ContactFlag.PREDICTED, ContactFlag.BOUNDED)
)
"""Flags as NumPy numbers, because operations with an IntFlag take ten times as long."""


class Surface(IntEnum):
    """Response of a part to contact."""

    UNKNOWN = contact_record.SURFACE_UNKNOWN
    RIGID = contact_record.SURFACE_RIGID
    DEFORMABLE = contact_record.SURFACE_DEFORMABLE


class Mode(IntEnum):
    """Advice for the controller of the drum; with less information it is more cautious."""

    RETRACT = contact_record.MODE_RETRACT
    """No contact is expected within the horizon."""
    POSITION = contact_record.MODE_POSITION
    """A rigid surface is near or touched: the drum is at the position of the contact."""
    FORCE = contact_record.MODE_FORCE
    """A deformable surface is near or touched: the drum presses by the surface's law."""
    HOLD = contact_record.MODE_HOLD
    """The state of the finger is unknown."""


CONTACT_FIELDS = (
    Field("finger", "<u4", "", "which finger: 0, 1, …"),
    Field("flags", "<u4", "", "set of ContactFlag"),
    Field("pose_ns", "<i8", "ns", "instant of the pose: all but the predictions hold for it"),
    Field("age_ns", "<i8", "ns", "of the pose at the tick"),
    Field("position", "<f8", "m", "centre of the fingertip sphere at pose_ns", VECTOR),
    Field("velocity", "<f8", "m/s", "of the finger", VECTOR),
    Field(
        "signed_distance", "<f8", "m", "of the sphere: that of its centre minus the radius; negative inside"
    ),
    Field("lower", "<f8", "m", "never above the true signed distance"),
    Field("upper", "<f8", "m", "never below it"),
    Field("point_on_finger", "<f8", "m", "the point of the sphere that is nearest", VECTOR),
    Field("point_on_part", "<f8", "m", "the point of the surface that is nearest", VECTOR),
    Field(
        "normal",
        "<f8",
        "",
        "unit, outward: steepest increase of the signed distance; 0 if undefined",
        VECTOR,
    ),
    Field("part_velocity", "<f8", "m/s", "of the part at point_on_part", VECTOR),
    Field("approach_speed", "<f8", "m/s", "-d/dt of the signed distance"),
    Field("predicted_ns", "<i8", "ns", "instant at which the controller acts; of the pose if that is later"),
    Field("predicted_distance", "<f8", "m", "expected then"),
    Field("predicted_lower", "<f8", "m", "bound of it, while the finger keeps to max_acceleration"),
    Field("predicted_upper", "<f8", "m", "likewise"),
    Field(
        "time_to_contact",
        "<f8",
        "s",
        "from pose_ns; 0 in contact, inf if none is expected within the horizon",
    ),
    Field(
        "time_to_contact_lower",
        "<f8",
        "s",
        "from pose_ns: certainly no surface is touched before, while velocities stay constant "
        "or the finger "
        "stays on its path",
    ),
    Field(
        "bend",
        "<f8",
        "",
        "of the finger at pose_ns, 0 to 1: on its path, or as given; nan: not known",
    ),
    Field("bend_rate", "<f8", "1/s", "of bend; nan: not known"),
    Field("contact_bend", "<f8", "", "first contact on the path; nan if there is none"),
    Field("contact_bend_error", "<f8", "", "maximum error of contact_bend"),
    Field("contact_bend_rate", "<f8", "1/s", "drift of contact_bend as the part moves; nan: not known"),
    Field("stiffness", "<f8", "N/m", "of a deformable part"),
    Field("damping", "<f8", "N s/m", "of a deformable part"),
    Field("force", "<f8", "N", "of a deformable part on the finger, or measured"),
    Field("part", "<i4", "", "index into scene.parts; -1: none"),
    Field("face", "<i4", "", "row of that part's solid.mesh.faces; -1: none"),
    Field("work", "<u4", "", "nodes and leaves visited"),
    Field("surface", "<u1", "", "a Surface"),
    Field("mode", "<u1", "", "a Mode"),
    Field("source", "<u1", "", "a Source"),
    Field("force_is_valid", "<u1", "", "1 where the force is valid"),
)


ContactField = Literal[
    "finger", "flags", "pose_ns", "age_ns", "position", "velocity", "signed_distance", "lower", "upper",
    "point_on_finger", "point_on_part", "normal", "part_velocity", "approach_speed", "predicted_ns",
    "predicted_distance", "predicted_lower", "predicted_upper", "time_to_contact",
    "time_to_contact_lower", "bend", "bend_rate", "contact_bend", "contact_bend_error",
    "contact_bend_rate", "stiffness", "damping", "force", "part", "face", "work", "surface", "mode",
    "source", "force_is_valid",
]  # fmt: skip
"""Names of `CONTACT_FIELDS`, with which type checkers find errors such as `contacts["signed_distanse"]`."""


class Contact(np.void):  # type: ignore[misc]  # NumPy's own `record` is made so
    """A record of `CONTACT` that prints as a short text."""

    if TYPE_CHECKING:

        def __getitem__(self, key: ContactField) -> Any: ...  # type: ignore[override]

    def __repr__(self) -> str:
        flags = [str(flag.name) for flag in ContactFlag if self["flags"] & flag]
        mode = Mode(self["mode"]).name if self["mode"] in set(Mode) else self["mode"]
        numbers = ", ".join(f"{name}={shown_number(self[name])}" for name in SHOWN_FIELDS)
        return f"Contact({numbers}, mode={mode}, flags={'|'.join(flags) or 0})"


SHOWN_FIELDS: tuple[ContactField, ...] = (
    "finger",
    "signed_distance",
    "lower",
    "upper",
    "time_to_contact",
    "part",
    "face",
)
"""Fields that the representation of a record shows, in addition to mode and flags."""
FEW_CONTACTS = 10
"""Maximum number of records shown in the representation of an array."""

CONTACT = np.dtype((Contact, dtype_of(CONTACT_FIELDS)))
"""One finger at one tick, 328 bytes."""


class Contacts(np.ndarray):
    """An array of `CONTACT` that prints without its dtype. Its fields are plain arrays."""

    if TYPE_CHECKING:

        def __iter__(self) -> Iterator[Contact]: ...  # type: ignore[override]

    @overload  # type: ignore[override]
    def __getitem__(self, key: ContactField) -> np.ndarray: ...
    @overload
    def __getitem__(self, key: int | np.integer) -> Contact: ...
    @overload
    def __getitem__(self, key: slice | list[int] | list[bool] | np.ndarray) -> "Contacts": ...
    def __getitem__(self, key: Any) -> Any:
        return self.view(np.ndarray)[key] if isinstance(key, str) else super().__getitem__(key)

    def __repr__(self) -> str:
        if self.dtype != CONTACT or self.ndim != 1:
            return repr(self.view(np.ndarray))
        lines = [repr(self[row]) for row in range(min(len(self), FEW_CONTACTS))]
        if len(self) > FEW_CONTACTS:
            lines.append(f"and {len(self) - FEW_CONTACTS} more")
        return f"Contacts([{(',' + chr(10) + ' ').join(lines)}])"
