"""Sealed frames like a service's, for tests of their processing."""

import numpy as np

from proximity.message import FRAME, ContactFlag, Message, State

SESSION = 1_790_000_000_000_000_000
PERIOD_NS = 1_000_000
GOOD = (
    ContactFlag.TRACKED
    | ContactFlag.PREDICTED
    | ContactFlag.EXACT
    | ContactFlag.SIGNED
    | ContactFlag.IN_RANGE
)


def frame(count=1, now_ns=0):
    """A valid unsealed message of *count* fingers at distances of 10 mm, 20 mm, …."""
    message = Message(FRAME, count)
    message.header["pose_ns"] = message.header["start_ns"] = message.header["publish_ns"] = now_ns
    message.header["valid_until_ns"] = now_ns + 20_000_000
    message.header["period_ns"] = PERIOD_NS
    message.header["state"] = State.OK
    contacts = message.records
    contacts["finger"] = np.arange(count)
    contacts["flags"] = GOOD
    contacts["pose_ns"] = now_ns
    contacts["normal"] = [0.0, 0.0, 1.0]
    for name in ("signed_distance", "lower", "upper"):
        contacts[name] = 0.01 * (1 + np.arange(count))
    contacts["predicted_distance"] = contacts["lower"] / 3.0
    contacts["time_to_contact"] = np.inf
    return message


def sealed(sequences, count=1, session=SESSION):
    """Bytes of consecutive frames with these numbers."""
    message = frame(count)
    pieces = []
    for sequence in sequences:
        message.header["start_ns"] = sequence * PERIOD_NS
        pieces.append(message.seal(session, sequence).tobytes())
    return b"".join(pieces)
