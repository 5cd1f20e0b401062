"""Studies of the DECAFF paper: its models and figures, stability, and simulated presses."""

import proximity.decaff  # noqa: F401  # names the extra if SciPy is missing
