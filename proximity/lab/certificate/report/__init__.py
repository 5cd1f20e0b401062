"""A certificate as JSON, as a page and as pictures."""
