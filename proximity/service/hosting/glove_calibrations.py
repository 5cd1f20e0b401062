"""Read the glove calibrations that a scene file names."""

import numpy as np

from proximity.errors import ArgumentError, DecaffError
from proximity.service import GloveChoices
from proximity.service.config import SceneFile

TABLE = 4097
"""Places of a table of counts: lines in between are off by less than a hundredth of a count."""


def read_gloves(settings: SceneFile, count: int) -> GloveChoices | None:
    """Return where fingertips go as fingers bend, by their calibrations; None where there is no [glove]."""
    glove = settings.glove
    if glove is None:
        return None
    # Only where there is a glove: the models bring half a second of imports.
    from proximity.decaff.glove.glove_set import as_many, read_glove

    try:
        worn = as_many([read_glove(path, glove.max_age_days) for path in glove.calibration], count)
    except (ArgumentError, DecaffError) as unfit:
        raise settings.error(("glove", "calibration"), f"glove.calibration: {unfit}") from unfit
    tables = [each.counts_table(TABLE) for each in worn]
    return GloveChoices(
        corners=np.stack([each.path_finger() for each in worn]),
        counts=np.stack([counts for counts, _ in tables]),
        bends=np.stack([bends for _, bends in tables]),
    )
