"""Guided calibration of a glove: tasks, instruments, readings and results."""
