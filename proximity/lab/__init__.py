"""Studies of the DECAFF paper: its models and figures, stability, and simulated presses."""

from proximity.system.extras import needed

with needed("studies and measurements need", "service"):
    import scipy  # noqa: F401
