"""Queries against a whole scene: parts with poses, and the trees over them."""
