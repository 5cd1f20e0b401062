"""A finger as a chain of links."""
