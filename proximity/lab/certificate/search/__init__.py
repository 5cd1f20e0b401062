"""The search for the positions in a scene where a tick takes longest."""
