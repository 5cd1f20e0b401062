"""Rules for using messages: limits, and the state of a receiver, shared by C and Python.

Receivers in every language use these limits: `message/c_header.py` and the layouts for C# and JavaScript
generate them, with the texts below them. All fields have eight bytes.
"""

from typing import Any

import numpy as np

MAX_VALID_NS = 1_000_000_000
"""Longest validity of a frame after its oldest pose, whatever the frame states."""
STALE_AFTER_NS = 80_000_000
"""Time after the end of validity at which a frame is stale."""
AHEAD_NS = 5_000_000
"""An instant farther in the future is an error of a clock."""
LAST_NS = 2**61 - 1
"""Largest valid instant, 73 years; the smallest is 0. Sums of a few must fit into 64 bits."""
UNIT_ERROR = 1e-3
"""Largest deviation of the length of a normal from 1."""
RESTART_SILENCE_NS = 50_000_000
"""A publisher that is silent for longer may have restarted with its calendar set back."""
MAX_SKIPPED = 100_000_000
"""Largest gap between two sequence numbers of a run; beyond it the message belongs to another run."""
MAX_RUNS = 64
"""Number of earlier runs of the publisher whose messages are recognised as repeated."""
MAX_KINDS = 4
"""Number of kinds of messages of one receiver."""
MAX_NAMES = 1 << 20
"""Largest number of names in a description."""
MAX_AT_ONCE = 1024
"""Largest number of messages read in one call: more than a transport buffers for a reader."""
MAX_FLAWED = 256
"""Largest number of flawed messages read in one call: a flood must not block a reader."""
NS_PER_DRIFT = 5000
"""Ns in which two quartz clocks may drift apart by one: 200e-6, twice their specification."""
TRANSIT_NS = 1_000_000
"""Assumed shortest transit of a message, which a receiver cannot measure alone."""
SETTLING_NS = 50_000_000
"""Time for which a clock is observed before it is used."""
PACE_NS = 25_000_000
"""Largest amount by which a message is faster than the first, or one that settles the clock is slower."""
JUMP_NS = 1_000_000_000
"""A new run that is later by more has another clock; a smaller delay may be a longer transit."""
BACK_NS = 5_000_000
"""Largest disorder between messages of threads that send concurrently; an earlier instant is a step back."""

LIMITS = {name: value for name, value in globals().items() if name.isupper()}
"""All limits by name."""

WHOLE, COUNT, REAL = "<i8", "<u8", "<f8"


def record(*fields: Any) -> np.dtype:
    """Return a record type; a field is names of integers, or a tuple of names, type and length."""
    listed = []
    for each in fields:
        names, kind, *lengths = (each, WHOLE) if isinstance(each, str) else each
        listed += [(name, kind, *lengths) for name in names.split()]
    return np.dtype(listed)


RUN = record(("kind session sequence", COUNT))
"""A run of a publisher that another one has followed, and its last sequence number."""
SEEN = record(("is_any session sequence", COUNT), "sent_ns taken_ns")
"""The last used message of one kind."""
CLOCK = record(
    "is_heard is_certain has_former",
    ("session", COUNT),
    "offset_ns heard_ns first_ns first_offset_ns sent_ns",
    "former_ns former_heard_ns",  # the clock before a frame that came too early
)
"""The clock of a sender on another machine."""
RECEIVER = record(
    "shares_clock is_keyed",  # set at the start; the others start at zero
    ("uncounted", COUNT),  # set at the start: a kind, from 1, that is not counted as received or lost
    "is_new_run",  # whether the last used message is of another run than the one before
    ("received lost sessions newest_session", COUNT),
    ("flawed", COUNT, 9),  # by Defect, from 1 on
    ("seen", SEEN, MAX_KINDS),
    ("ended", RUN, MAX_RUNS),  # oldest first
    ("ended_count", COUNT),
    ("clock", CLOCK),
)
"""State of a receiver: the last message of each kind, and the number of unused messages by reason."""

RECORDS = {
    "proximity_run": RUN,
    "proximity_seen": SEEN,
    "proximity_clock": CLOCK,
    "proximity_receiver": RECEIVER,
}
"""Record types by their names in C."""
