"""Arrays that are laid out as few are."""

import numpy as np


def unaligned(values):
    """The same numbers at an odd address."""
    found = np.ndarray(values.shape, values.dtype, np.empty(values.nbytes + 1, np.uint8), 1)
    found[...] = values
    return found
