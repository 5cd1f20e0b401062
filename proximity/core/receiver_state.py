"""What decides whether a message is used: limits, and the state of a receiver, which C and Python share.

Receivers in every language take the limits from here: `message/c_header.py` and the layouts for C# and
JavaScript generate them, with the texts below them. All fields are of eight bytes.
"""

from typing import Any

import numpy as np

LONGEST_VALID_NS = 1_000_000_000
"""After its oldest pose no frame is valid for longer, whatever it says."""
STALE_AFTER_NS = 80_000_000
"""From then on, until its bounds are worth nothing."""
AHEAD_NS = 5_000_000
"""An instant farther in the future is a mistake of some clock."""
LAST_NS = 2**61 - 1
"""So is one that is later, or before 0: 73 years. Sums of a few must be numbers of 64 bits as well."""
UNIT_ERROR = 1e-3
"""By how much the length of a normal may differ from 1."""
RESTART_SILENCE_NS = 50_000_000
"""A publisher that is silent for longer may have been started anew with its calendar put back."""
MOST_SKIPPED = 100_000_000
"""Numbers that may be missing between two messages of a run: one that is farther on is none of it."""
MOST_RUNS = 64
"""Runs of the publisher that are remembered: what came of them does not come again."""
MOST_KINDS = 4
"""Kinds of messages that one receiver takes."""
MOST_NAMES = 1 << 20
"""Names of a description: who claims more is not believed."""
MOST_AT_ONCE = 1024
"""Messages taken in one go: more than a transport keeps for a reader."""
MOST_FLAWED = 256
"""Of these, such that cannot be used: a flood must not keep a reader from its work."""
NS_PER_DRIFT = 5000
"""In which two quartz clocks may drift apart by one: 200e-6, twice what their makers promise."""
TRANSIT_NS = 1_000_000
"""A message is thought to have travelled that long at least: what no receiver can measure alone."""
SETTLING_NS = 50_000_000
"""For so long a clock is watched before it is believed."""
PACE_NS = 25_000_000
"""By how much messages may be faster on their way than the first, and one that settles slower."""
JUMP_NS = 1_000_000_000
"""A new run that begins later by more has another clock; less may be a longer way."""
BACK_NS = 5_000_000
"""By how much threads that send side by side may be out of order; an instant earlier by more steps back."""

LIMITS = {name: value for name, value in globals().items() if name.isupper()}
"""All of them, by their names."""

WHOLE, COUNT, REAL = "<i8", "<u8", "<f8"


def record(*fields: Any) -> np.dtype:
    """A record of fields: names, apart by spaces, of whole numbers; or such names, a type, and a length."""
    listed = []
    for each in fields:
        names, kind, *lengths = (each, WHOLE) if isinstance(each, str) else each
        listed += [(name, kind, *lengths) for name in names.split()]
    return np.dtype(listed)


RUN = record(("kind session sequence", COUNT))
"""A run of a publisher that another one has followed, and the last number of it."""
SEEN = record(("is_any session sequence", COUNT), "sent_ns taken_ns")
"""Of one kind of messages: the last one that was used."""
CLOCK = record(
    "is_heard is_certain has_former",
    ("session", COUNT),
    "offset_ns heard_ns first_ns first_offset_ns sent_ns",
    "former_ns former_heard_ns",  # what was believed until a frame came too early
)
"""The clock of a sender on another machine."""
RECEIVER = record(
    "shares_clock is_keyed",  # set at the beginning, all else is zero
    ("uncounted", COUNT),  # likewise: from 1 on, a kind of which none is counted as received or lost; 0: none
    "is_new_run",  # whether the message that was used last is of another run than the one before
    ("received lost sessions newest_session", COUNT),
    ("flawed", COUNT, 9),  # by Defect, from 1 on
    ("seen", SEEN, MOST_KINDS),
    ("ended", RUN, MOST_RUNS),  # oldest first
    ("ended_count", COUNT),
    ("clock", CLOCK),
)
"""State of a receiver: what came last of each kind, and how many messages were not used for which reason."""

RECORDS = {
    "proximity_run": RUN,
    "proximity_seen": SEEN,
    "proximity_clock": CLOCK,
    "proximity_receiver": RECEIVER,
}
"""By their names in C."""
