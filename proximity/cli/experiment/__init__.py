"""Sessions of an experiment with a person, at a page or at the terminal."""
