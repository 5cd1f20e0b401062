"""Single ticks of a tracker: thread time and wall time of each."""
