"""Studies of the DECAFF paper: its models and figures, stability, and simulated presses."""
