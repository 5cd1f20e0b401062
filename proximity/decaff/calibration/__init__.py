"""Calibration that a person can do: what is asked, the instruments, the readings, and what they say."""
