"""The eight-wide tree over boxes: building, refitting and walking it."""
