"""Queries of a scene: points, rays, segments, and budgeted distance bounds of a point."""
