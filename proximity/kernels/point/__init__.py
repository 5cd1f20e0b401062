"""Closest point of one part: exact, within a budget, or from the last answer."""
