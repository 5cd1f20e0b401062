"""Arrays with unusual memory layouts."""

import numpy as np


def unaligned(values):
    """Copy an array to an odd address."""
    found = np.ndarray(values.shape, values.dtype, np.empty(values.nbytes + 1, np.uint8), 1)
    found[...] = values
    return found
