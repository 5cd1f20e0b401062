"""Guide through a calibration: the terminal and a page are two ways to ask for the same steps."""
