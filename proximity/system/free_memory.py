"""Memory that has been freed, for the system to have back.

What reading a large part takes for a while lies between what stays. glibc keeps such pages for later: of a
part of a million faces that would be 120 bytes a face.
"""

import ctypes
from contextlib import suppress


def return_free_memory() -> None:
    """Give freed pages back, where the C library can.

    Notes
    -----
    Cost: 20 ms for 150 MB, in which other threads may wait for memory.
    """
    with suppress(AttributeError, OSError, TypeError):  # another library than glibc
        ctypes.CDLL(None).malloc_trim(0)
