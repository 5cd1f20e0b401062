"""The glove: bend of a finger to angle of its drum, and calibration."""
