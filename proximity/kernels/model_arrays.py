"""The four arrays of a model, as entry points take them; `layout` says what is where."""

from typing import NamedTuple

import numpy as np

from proximity.native import bundle


class ModelArrays(NamedTuple):
    """A solid, or a scene of hundreds: what most kernels are handed first."""

    reals: np.ndarray  # (R,) float64
    words: np.ndarray  # (W,) float32
    frames: np.ndarray  # (P + 1,) FRAME
    parts: np.ndarray  # (P + 1,) PART


bundle(ModelArrays, reals="float64[:]", words="float32[:]", frames="Frame[:]", parts="Part[:]")
