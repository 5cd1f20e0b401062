"""Queries of a scene: points, rays, segments, and a point between bounds within a budget."""
