"""One part as a model of its own: its arrays, in memory of the caller, and its sign."""
