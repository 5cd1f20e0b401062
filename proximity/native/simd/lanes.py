"""How wide vectors are."""

LANES = 8
"""Lanes of every vector type."""
