"""Memory shared by Python and the compiled loop of a service: records, as NumPy dtypes.

`tools/core_tables.py` generates the structures in C from these. All fields have eight bytes; addresses are
those of NumPy's arrays.
"""

from proximity.core.receiver_state import REAL, RECEIVER, WHOLE
from proximity.core.receiver_state import record as _record

BINS, OUTPUTS, HOSTS, STATES = 1216, 8, 4, 6
"""Lengths, in C ``LOOP_BINS`` and so on."""


MOTION = _record(
    "number",  # of the report; 0: there is none
    "pose_ns ends_ns",  # assumed to continue until ends_ns
    "is_moving is_hidden",
    ("matrix", REAL, 16),
    ("velocity turning", REAL, 3),  # world_from_part, m; m/s, of the origin, and rad/s about it
    ("across back", REAL, 9),  # effect of a rotation: by the sine of the angle, and by 1 - cosine
    ("turn_rate top_speed", REAL),  # rad/s; m/s, of its fastest point
)
"""The reported motion of a part."""
SENSOR = _record(
    "motions error_sums unknown",  # of each finger: estimates, and the contact of an untracked finger
    "latency_ns",
    ("horizon max_speed max_acceleration", REAL),
)
"""A sensor that measures distances, instead of a scene."""
SOURCE = _record(
    "sensor",  # 0: there is a scene
    "model",  # words of its arrays, as kernels take them
    "tracker",  # its arrays, as `TrackerArrays`
    "bend_motions",  # estimates of the bends, two a finger
    "epoch",  # of the scene
    "is_moved",  # whether parts have moved since the tracker's last tick
    "answers",  # bits of the answers of all ticks
    "scene",  # a proximity_scene, in which the loop moves parts; 0: they are static
    "motions next_motions",  # a LoopMotion a part: in use, and newer ones; 0: there are none
    "applied",  # numbers of the reports that were applied
    "rows matrices velocities turnings",  # of parts to move: scratch
    "has_looked all_stand",  # whether `motions` were applied; whether all parts are silent
    "is_edited rows_after",  # whether it is the previous source with other parts; their present rows
)
"""A scene and its tracker. The loop switches to the next between ticks, and returns the last to Python."""
CONTACTS = _record(
    "source epoch",  # the LoopSource of the contacts
    "is_late",
    "spent_ns",  # time that a simulated clock advanced while they were computed
)
"""Contacts that were computed outside the loop; the records follow."""
OUTPUT = _record(
    "socket",  # connected; -1: none
    "box",  # a proximity_mailbox open for writing; 0: none
    "key",  # 32 bytes; 0: no tags
    "session",  # ns of the calendar
    ("sequences", WHOLE, 2),  # the next numbers of frames and of descriptions
    "awake_ns",  # calendar minus monotonic clock at the last message
    "failures",  # frames that could not be sent, and the first error (errno)
    "first_failure",
    "lost",  # frames dropped by the system for lack of buffers
)
INPUT = _record(
    "is_measured",  # whether messages are a sensor's, not poses
    "socket",  # -1: none
    "timer",  # ends the wait at the socket
    "box",  # a proximity_mailbox for reading, open or not; 0: none
    "name",  # of the mailbox; 0: it is in the memory of this process
    ("hosts", WHOLE, HOSTS),
    "host_count port",  # IPv4, in network order; 0: any port
    "key",
    "message longest",  # buffer of a message, and its size
    "refused unverified unserved failures first_failure",
    ("receiver", RECEIVER),
    "looked_ns",
)
RECORDING = _record(
    "times_ns positions rows",  # from 0 on; of all fingers; 0: there is none
    "latency_ns round_ns",  # age of a pose on arrival; length of a round, 0: no repetition
    "row start_ns has_begun is_over",  # the last row played, and the instant of the first
)
"""Recorded poses, played by their times."""
TIMES = _record(
    "count max_ns",
    ("bins", WHOLE, BINS),
)
"""A histogram of durations."""
LOOP = _record(
    "instructions",  # name of the set of instructions
    "set",  # that set, once it was found: the search is slow
    "count",  # of fingers
    "period_ns valid_for_ns stale_after_ns",
    "is_simulated simulated_ns",  # a clock that jumps to the next instant
    "is_coarse",  # whether the system's monotonic clock is the coarse one of Windows
    "is_ahead",  # whether that clock is ahead of the clock of the frames' readers
    "counts_processor",  # whether ticks are timed by the thread's processor time
    "is_given",  # whether contacts are computed outside the loop, and arrive as messages: LoopContacts
    "is_polled",  # whether arriving poses do not wake it: a thread polls for them
    "is_late",  # whether the input of the contacts is too old already
    "frame",  # the message
    "pose_ns positions width refused_ns row_of",  # of the newest poses, a row a finger; or distances
    "measured",  # newest measurements
    "velocities paths bends has_velocities has_paths has_bends",
    "given_ns given fingers defects",  # of the poses of a message
    "lost_hand",  # defect code of the kernels for a pose of a lost hand
    ("metres_a_bend", REAL),  # converts bends to lengths for the estimates of motion
    "next source",  # the source from the next tick on; the present source
    "stop ticks_wanted",  # -1: no limit
    "pending pending_size",  # a message of the description, to be sent after the next frame
    "is_begun due_ns posed_ns epoch_offset epoch",
    "has_started reported_missed",
    "ticks missed",
    ("states", WHOLE, STATES),
    "future backwards too_old lost_hands",
    ("first_off_ns", WHOLE, 4),  # of the first ones of these kinds
    ("compute lateness", TIMES),
    ("input", INPUT),
    ("recording", RECORDING),
    ("outputs", OUTPUT, OUTPUTS),
    "output_count",
    "log",  # a proximity_mailbox without a file, for frames as sealed by the first output; 0: none
    "datagram",  # buffer for tagged messages
)

LENGTHS = {
    "BINS": BINS,
    "OUTPUTS": OUTPUTS,
    "HOSTS": HOSTS,
    "STATES": STATES,
}
RECORDS = {
    "LoopMotion": MOTION,
    "LoopSensor": SENSOR,
    "LoopSource": SOURCE,
    "LoopContacts": CONTACTS,
    "LoopOutput": OUTPUT,
    "LoopInput": INPUT,
    "LoopRecording": RECORDING,
    "LoopTimes": TIMES,
    "Loop": LOOP,
}
"""Record types by their names in C."""
