"""Queries of a whole scene: parts with poses, and the trees over them."""
