"""Eight-wide tree over boxes: building, refitting and bounds."""
