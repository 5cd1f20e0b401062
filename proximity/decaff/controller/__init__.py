"""The controller of one drum: states, limits, and how far a frame is trusted."""
