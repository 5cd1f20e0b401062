"""A recording through a tracker, with a check of its bounds."""
