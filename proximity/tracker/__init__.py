"""Fingers that are followed from tick to tick."""
