"""Controller of one drum: states, limits, and trust in frames."""
