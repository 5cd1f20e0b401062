"""Records as plain columns: a vector becomes three columns of numbers."""

import numpy as np


def scalar_columns(records: np.ndarray) -> dict[str, np.ndarray]:
    """Return one column for each number of the records, in their order; vectors end in _x, _y and _z.

    *records*: (N,) structured.
    """
    columns: dict[str, np.ndarray] = {}
    for name in records.dtype.names or ():
        if records.dtype[name].shape == (3,):
            columns |= {f"{name}_{axis}": records[name][:, column] for column, axis in enumerate("xyz")}
        else:
            columns[name] = records[name]
    return columns
