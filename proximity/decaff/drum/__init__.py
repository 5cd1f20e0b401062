"""The contact drum: a motor with a servo."""
