"""The latency certificate of a user's own scene: what ticks cost at its worst places, against sample periods."""
