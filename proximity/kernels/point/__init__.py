"""Search for the closest point of one part: exact, within a budget, or starting from the last answer."""
