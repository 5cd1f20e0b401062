"""Thickness of parts: at points, and of a whole part with a certain lower bound."""
