"""The glove: from the bend of a finger to the angle of its drum, and calibration."""
