"""Trees of eight children per node over boxes: building, refitting and bounds."""
