"""The contact drum as a motor with a servo."""
