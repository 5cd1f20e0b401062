"""One part as a separate model: its arrays, in memory of the caller, and its sign."""
